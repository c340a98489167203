"""Comparison of two campaigns of one vehicle: changes and their probabilities."""
