"""The parameter file, whether it still holds, and whether two methods say the same of what is in it."""
