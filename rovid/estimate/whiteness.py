"""Whether innovations are white, and what a model would gain that leaves them so."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.stats import chi2_sf

_WHITE_LAGS = 20
_WHITE_P = 1e-3
_KURTOSIS = 1.0


def whitening_gain(series: Sequence[FloatArray]) -> float:
    """Log-likelihood that ``series`` would gain, were each value predicted from those before it.

    Half the count of the logarithm of how much the variance falls in an autoregression (Ljung 1999, section 16.4).
    """
    from scipy import linalg

    power = np.array([_product(series, lag) for lag in range(_WHITE_LAGS + 1)])
    if power[0] <= 0.0:
        return 0.0
    # The least noise keeps a series that repeats itself exactly from having no predictor.
    noise = 1e-9 * power[0] * (np.arange(_WHITE_LAGS) == 0)
    predictor = linalg.solve_toeplitz(power[:-1] + noise, power[1:])
    left = 1.0 - float(predictor @ power[1:]) / power[0]
    count = sum(map(len, series))
    return -0.5 * count * math.log(max(left, 1e-12))


def _product(series: Sequence[FloatArray], lag: int) -> float:
    """Sum of all values times those ``lag`` places on."""
    return sum(float(z[lag:] @ z[: len(z) - lag]) for z in series if len(z) > lag)


def is_white(series: Sequence[FloatArray]) -> bool:
    """Whether normalised innovations are white (Ljung-Box over all trials) and without heavy tails.

    Spikes leave innovations white, so that the kurtosis is looked at too.
    """
    count = sum(map(len, series))
    power = sum(float(z @ z) for z in series)
    statistic = 0.0
    for lag in range(1, _WHITE_LAGS + 1):
        statistic += (_product(series, lag) / power) ** 2 / (count - lag)
    chi2 = count * (count + 2.0) * statistic
    fourth = sum(float(np.sum(z**4)) for z in series) * count / power**2
    return chi2_sf(_WHITE_LAGS, chi2) > _WHITE_P and fourth - 3.0 < _KURTOSIS
