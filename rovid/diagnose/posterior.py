"""How sure a cause is: its odds against all else that was tried in its place, nothing at all included."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from rovid.core.stats import logistic, logit

# A cause that is surer is established; one that is less so is not worth a crew's time.
ESTABLISHED, POSSIBLE = 0.95, 0.2
# Odds, before the logs are looked at, that one cause more acts than those that are known: even.
PRIOR_ODDS = 1.0
# Nothing that rests on one set of logs is surer.
_SUREST = 0.97
# What no equation of the catalogue says is taken up by one that resembles it. In hard water that gains up to
# log-likelihoods of the first size as often as what acts, and each further one of the second multiplies the odds by e;
# where the data are explained to the noise there is little to resemble.
_RESEMBLES, _RESEMBLES_LESS = (6.0, 4.7), (6.0, 2.35)
# Logarithm of the odds that are said: that by which they are higher, and the share of those that were worked out.
_MORE_ACTS, _TEMPER = 0.85, 0.75


def stand_in_cap(held_out_gain: float, worth: float, *, white: bool) -> float:
    """Probability that what gains such a log-likelihood on trials not fitted is no stand-in for something else.

    Parameters
    ----------
    worth
        What it gains in the fit, less the price of its parameters.
    white
        Whether the data are explained down to white innovations. There both gains mean what they say, and the lesser
        counts: of all that was tried, one gains on a few trials by chance.
    """
    gain, (even, step) = (min(held_out_gain, worth), _RESEMBLES_LESS) if white else (held_out_gain, _RESEMBLES)
    return min(logistic((gain - even) / step), _SUREST)


def recalibrated(sure: float, *, white: bool) -> float:
    """What is said where the likelihood and the gain on trials not fitted make a cause ``sure``, both in 0 to 1.

    Where the innovations are not white readings are not as independent as a likelihood has it, and more acts than one
    cause: what was sure by 0.04, 0.25, 0.5, 0.7, 0.9 acted in 0.24, 0.55, 0.71, 0.85 and 0.92 of the cases, in three
    seeds of hard water. Where they are white, a likelihood is taken at its word.
    """
    return sure if white else logistic(_MORE_ACTS + _TEMPER * logit(sure))


def posterior_probability(
    bic_gains: Mapping[str, float], equivalent: Collection[str], causes_tried: int, *, cap: float = _SUREST
) -> float:
    """Probability that one of the causes ``alike`` acts, rather than another one or none.

    Parameters
    ----------
    worths
        Cause -> log-likelihood that it gains in its best form, less the price of its parameters (Schwarz 1978: its
        exponential is the Bayes factor).
    tried
        How many causes were looked at, those included that promised too little to be fitted: they share the odds that
        any acts at all.
    most
        No cause is surer than that; see `surest`.
    """
    # All are taken relative to the largest, whose exponential might overflow.
    top = max([0.0, *bic_gains.values()])
    prior = PRIOR_ODDS / max(causes_tried, 1)
    weights = {name: prior * math.exp(worth - top) for name, worth in bic_gains.items()}
    total = math.exp(-top) + sum(weights.values())
    own = sum(weights.get(name, 0.0) for name in equivalent)
    return min(own / total, cap)
