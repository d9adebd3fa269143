"""What the stages `look`, `name` and `instruct` do: visibility, names of objects, texts."""
