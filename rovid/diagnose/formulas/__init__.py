"""Formulas for torque that no effect explains: grammar, regression on the innovations, and the effect file."""
