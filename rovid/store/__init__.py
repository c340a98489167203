"""The study of a campaign, the parameter file with its history, and checks of freshness and agreement."""
