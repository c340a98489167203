"""The model, its compiled loops, and its free-running simulation."""
