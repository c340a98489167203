"""Name That Cause: sealed campaigns of simulated vehicles; whoever reads them answers what acts, and how large.

``python -m benchmarks.challenge`` runs a round with all baselines and writes docs/challenge.md, where the rules stand.
"""
