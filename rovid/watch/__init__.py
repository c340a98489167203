"""A trial day as it goes on: which logs are whole, what each added, and whether that is enough."""
