"""Common scale of all thrust: by a pull, by a lift, or by a step of known inertia.

Heading data alone never determine the scale: s times the thrust with s times inertia and drag gives the same motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.stats import t_quantile

# Readings below which the scatter gives no standard error.
_FEWEST = 3
# Standard errors by which a step of inertia has to differ from zero.
_VISIBLE = 3.0


@dataclass(frozen=True, kw_only=True)
class ThrustScale:
    """True thrust over that of the curves."""

    value: float
    scatter: float  #: Standard error relative to ``value``, from the scatter of the readings.
    degrees_of_freedom: float  #: Of ``scatter``.
    reference_error: float  #: Relative standard error of the balance, the weight or the added inertia.
    method: str
    readings: int

    @property
    def standard_error(self) -> float:
        """Standard error of ``value``."""
        return self.value * math.hypot(self.scatter, self.reference_error)

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval: Student's t for the scatter, and a normal factor for the reference."""
        quantile = 0.5 + level / 2.0
        reach = math.hypot(
            t_quantile(quantile, self.degrees_of_freedom) * self.scatter,
            t_quantile(quantile, math.inf) * self.reference_error,
        )
        return self.value * math.exp(-reach), self.value * math.exp(reach)


def scale_from_pulls(curve: FloatArray, measured: FloatArray, reference_error: float) -> ThrustScale:
    """Regression through the origin of (n,) ``measured`` forces on those of the ``curve``, at independent readings.

    Raises
    ------
    DataError
        There are too few readings, or no thrust.
    """
    value, error = _through_origin(curve, measured)
    return ThrustScale(
        value=value,
        scatter=error / value,
        degrees_of_freedom=len(curve) - 1,
        reference_error=reference_error,
        method="regression of measured force on the curve's",
        readings=len(curve),
    )


def scale_from_lifts(curve: FloatArray, weight: FloatArray, reference_error: float) -> ThrustScale:
    """Inverse regression: the (n,) ``weight`` is known, and the thrust of the ``curve`` that holds it scatters.

    Raises
    ------
    DataError
        There are too few readings, or no weight.
    """
    slope, error = _through_origin(weight, curve)
    return ThrustScale(
        value=1.0 / slope,
        scatter=error / slope,
        degrees_of_freedom=len(curve) - 1,
        reference_error=reference_error,
        method="regression of the curve's thrust on the known weight",
        readings=len(curve),
    )


def scale_from_step(
    before: tuple[float, float], after: tuple[float, float], added: float, reference_error: float
) -> ThrustScale:
    """Known ``added`` inertia over the step of the inertia that was fitted ``before`` and ``after`` (value, error).

    Raises
    ------
    DataError
        The fitted inertia did not grow by more than its error.
    """
    step, error = after[0] - before[0], math.hypot(after[1], before[1])
    if not step > _VISIBLE * error:
        text = f"the fitted inertia grew by {step:.4g} ± {error:.2g}, which does not show the added {added:.4g}."
        raise DataError(text, mend="Add more, or record more sines with and without it.")
    return ThrustScale(
        value=added / step,
        scatter=error / step,
        degrees_of_freedom=math.inf,
        reference_error=reference_error,
        method="known added inertia over the step of the fitted inertia",
        readings=2,
    )


def _through_origin(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope of y = slope * x, and its standard error from the residuals."""
    if len(x) < _FEWEST:
        raise DataError(f"there are {len(x)} readings; at least {_FEWEST} were expected.", mend="Repeat the test.")
    size = float(x @ x)
    slope = float(x @ y) / size if size > 0.0 else 0.0
    if not slope > 0.0:
        text = "the measured force does not act in the sense of the curves' thrust, or there is no thrust."
        raise DataError(text, mend="Give pulls as positive forces, and commands that push the same way.")
    residuals = y - slope * x
    return slope, math.sqrt(float(np.sum(residuals**2)) / (len(x) - 1) / size)
