"""What the model gets wrong, why, and how much better it can be."""
