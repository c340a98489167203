"""The command line, its manual, and what the shell completes."""
