"""`vlnpe drive`: a person drives a robot in real time, in a page in the browser."""
