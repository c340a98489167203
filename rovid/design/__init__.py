"""The next run: which command would tell rivals apart, or narrow a parameter, best for its time."""
