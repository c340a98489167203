"""Tail probabilities and quantiles of common distributions.

scipy is imported at the first call: importing it takes a sixth of a command's start, and most commands need none of
this.
"""

import math
from functools import cache
from types import ModuleType

# Standard errors to either end of a two-sided 95 % interval of the normal distribution.
NORMAL_95 = 1.959964


@cache
def _special() -> ModuleType:
    from scipy import special

    return special


def chi2_sf(dof: float, value: float) -> float:
    """Probability that chi-square with ``dof`` degrees of freedom exceeds ``value``."""
    return float(_special().chdtrc(dof, value))


def f_sf(numerator_dof: float, denominator_dof: float, ratio: float) -> float:
    """Probability that Fisher's F exceeds ``ratio``."""
    return float(_special().fdtrc(numerator_dof, denominator_dof, ratio))


def f_cdf(numerator_dof: float, denominator_dof: float, ratio: float) -> float:
    """Probability that Fisher's F is less than ``ratio``."""
    return float(_special().fdtr(numerator_dof, denominator_dof, ratio))


def t_cdf(dof: float, value: float) -> float:
    """Probability that Student's t is less than ``value``."""
    return float(_special().stdtr(dof, value))


def t_quantile(probability: float, dof: float) -> float:
    """Quantile of Student's t; of the normal distribution if ``dof`` is infinite."""
    return float(_special().ndtri(probability) if math.isinf(dof) else _special().stdtrit(dof, probability))


def logistic(log_odds: float) -> float:
    """Probability with these logarithmic odds."""
    return float(_special().expit(log_odds))


def logit(probability: float) -> float:
    """Logarithmic odds of a probability; infinite at 0 and 1."""
    return float(_special().logit(probability))
