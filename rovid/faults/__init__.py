"""Faults of logs: one file for each, with its detector and its remedy; `catalogue` lists them."""
