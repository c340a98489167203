"""Pages of the documentation and their generators."""
