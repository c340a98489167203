"""The model, its compiled loops, a plain reference of them, and the free-running simulation."""
