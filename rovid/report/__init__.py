"""Plots and one page that hold the whole result."""
