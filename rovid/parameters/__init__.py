"""The parameter file, and whether two methods say the same of what is in it."""
