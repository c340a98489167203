"""Results as JSON, as tables, and a diagnosis in words."""
