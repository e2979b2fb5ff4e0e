"""The command line: options, progress, messages and exit codes. Everything else is in `pipelines`."""
