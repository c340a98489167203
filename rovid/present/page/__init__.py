"""The page that holds the whole result."""
