"""A trial day in progress: complete logs, what each log added to the model, and the stop criteria."""
