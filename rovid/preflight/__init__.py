"""Before a fit: what the columns hold, a first rovid.toml, what a campaign can tell."""
