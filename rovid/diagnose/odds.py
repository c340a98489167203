"""How sure a cause is: its odds against all else that was tried in its place, nothing at all included."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

# A cause that is surer is established; one that is less so is not worth a crew's time.
ESTABLISHED, POSSIBLE = 0.95, 0.2
# Odds, before the logs are looked at, that one cause more acts than those that are known.
PRIOR_ODDS = 0.5
# Nothing that rests on one set of logs and on equations that nature does not know is surer: in hard water one cause in
# ten or so that was established stands in for what no equation of the catalogue says, however much it gains.
_SUREST = 0.97


def confidence(worths: Mapping[str, float], alike: Collection[str], tried: int) -> float:
    """Probability that one of the causes ``alike`` acts, rather than another one or none.

    Parameters
    ----------
    worths
        Cause -> log-likelihood that it gains in its best form, less the price of its parameters (Schwarz 1978: its
        exponential is the Bayes factor).
    tried
        How many causes were looked at, those included that promised too little to be fitted: they share the odds that
        any acts at all.
    """
    # All are taken relative to the largest, whose exponential might overflow.
    top = max([0.0, *worths.values()])
    prior = PRIOR_ODDS / max(tried, 1)
    weights = {name: prior * math.exp(worth - top) for name, worth in worths.items()}
    total = math.exp(-top) + sum(weights.values())
    own = sum(weights.get(name, 0.0) for name in alike)
    return min(own / total, _SUREST)
