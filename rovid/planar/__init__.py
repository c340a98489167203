"""Surge, sway and yaw together, in a current."""
