"""What was measured, and of which vehicle: axes, trials, thrusters, tables, rovid.toml."""
