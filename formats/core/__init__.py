"""Records, frames, typed errors and atomic files that every format shares."""
