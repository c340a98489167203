"""Tail probabilities and quantiles of common distributions.

scipy is imported at the first call: importing it takes a sixth of a command's start, and most commands need none of
this.
"""

import math

# Standard errors to either end of a two-sided 95 % interval of the normal distribution.
NORMAL_95 = 1.959964


def chi2_sf(dof: float, value: float) -> float:
    """Probability that chi-square with ``dof`` degrees of freedom exceeds ``value``."""
    from scipy import special

    return float(special.chdtrc(dof, value))


def f_sf(numerator_dof: float, denominator_dof: float, ratio: float) -> float:
    """Probability that Fisher's F exceeds ``ratio``."""
    from scipy import special

    return float(special.fdtrc(numerator_dof, denominator_dof, ratio))


def f_cdf(numerator_dof: float, denominator_dof: float, ratio: float) -> float:
    """Probability that Fisher's F is less than ``ratio``."""
    from scipy import special

    return float(special.fdtr(numerator_dof, denominator_dof, ratio))


def t_cdf(dof: float, value: float) -> float:
    """Probability that Student's t is less than ``value``."""
    from scipy import special

    return float(special.stdtr(dof, value))


def t_quantile(probability: float, dof: float) -> float:
    """Quantile of Student's t; of the normal distribution if ``dof`` is infinite."""
    from scipy import special

    return float(special.ndtri(probability) if math.isinf(dof) else special.stdtrit(dof, probability))


def logistic(log_odds: float) -> float:
    """Probability with these logarithmic odds."""
    from scipy import special

    return float(special.expit(log_odds))


def logit(probability: float) -> float:
    """Logarithmic odds of a probability; infinite at 0 and 1."""
    from scipy import special

    return float(special.logit(probability))
