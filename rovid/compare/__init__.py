"""Two campaigns of one vehicle: what changed between them, and how sure that is."""
