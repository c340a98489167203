"""What Sphinx does not bring for these pages."""
