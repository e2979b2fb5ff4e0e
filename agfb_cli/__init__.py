"""What the user types: options, progress, messages and exit codes. Everything else is in `pipelines`."""
