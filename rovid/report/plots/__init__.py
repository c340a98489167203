"""The report's figures, one file each. Each function takes evidence and returns a figure; nothing is written."""
