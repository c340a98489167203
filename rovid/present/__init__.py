"""Results for people and programs: JSON documents, terminal text, tables, plots and the page."""
