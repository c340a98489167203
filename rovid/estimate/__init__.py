"""Steady drag, sine inertia and regression; each returns an Estimate."""
