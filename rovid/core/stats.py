"""Tails and quantiles of the usual distributions.

Whoever asks first imports them: that takes a sixth of the start of a command, and most commands need none.
"""

from __future__ import annotations

import math


def chi2_sf(freedom: float, value: float) -> float:
    """Probability that chi-square with so many degrees of freedom is larger."""
    from scipy import special

    return float(special.chdtrc(freedom, value))


def f_sf(above: float, below: float, ratio: float) -> float:
    """Probability that Fisher's F is larger, with degrees of freedom ``above`` and ``below`` the line."""
    from scipy import special

    return float(special.fdtrc(above, below, ratio))


def f_cdf(above: float, below: float, ratio: float) -> float:
    """Probability that Fisher's F is smaller; see `beyond_f`."""
    from scipy import special

    return float(special.fdtr(above, below, ratio))


def t_cdf(freedom: float, value: float) -> float:
    """Probability that Student's t is smaller."""
    from scipy import special

    return float(special.stdtr(freedom, value))


def t_quantile(probability: float, freedom: float) -> float:
    """Quantile of Student's t; of the normal distribution for infinite degrees of freedom."""
    from scipy import special

    return float(special.ndtri(probability) if math.isinf(freedom) else special.stdtrit(freedom, probability))


def logistic(log_odds: float) -> float:
    """Probability of what has such odds."""
    from scipy import special

    return float(special.expit(log_odds))


def logit(probability: float) -> float:
    """Logarithm of the odds of what is so probable; infinite at 0 and 1."""
    from scipy import special

    return float(special.logit(probability))
