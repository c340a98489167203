"""Sphinx extensions for these pages."""
