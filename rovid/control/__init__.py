"""The heading controller for the identified vehicle: law, tuning, closed-loop runs, generated source."""
