"""Experiment design: the run to make next."""
