"""The command line, its manual and shell completion."""
