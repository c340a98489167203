"""The measurements and the vehicle: axes, trials, thrusters, tables, rovid.toml."""
