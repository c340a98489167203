"""Many campaigns, each diagnosed in a process of its own: a table of all, and a page."""
