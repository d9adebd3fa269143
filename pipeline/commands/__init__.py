"""One module per group of commands: options in, stages run, an exit code out."""
