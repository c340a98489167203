"""What every identification returns: values, covariance, and what could not be determined."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.stats import t_quantile
from rovid.model.parameter_names import unit_of
from rovid.trial.assumptions import Assumptions, scales_with_thrust
from rovid.trial.axis import YAW, Axis
from rovid.trial.trial import read_only

# What the unit of a torque, and of all that is larger with it, ends in where the inertia is not known.
PER_INERTIA = " per kg m^2"
UNDRIVEN = (
    "nothing drives these logs, so that the inertia cannot be known: every torque and drag is that of 1 kg m^2 of it"
)
# A share of all thrust that is not worth a word.
_NO_DOUBT = 1e-3
# Of what is as good as constant: its changes are rounding.
_ROUNDING = 1e-9


# Standard errors from zero from which on a number may be divided by.
_FROM_ZERO = 3.0
_SYMBOLS = {"inertia": "I", "quadratic_drag": "DQ", "linear_drag": "DL"}
_OVER = {
    ("inertia", "quadratic_drag"): "rad",
    ("inertia", "linear_drag"): "s",
    ("linear_drag", "quadratic_drag"): "rad/s",
}


@dataclass(frozen=True, kw_only=True)
class Ratio:
    """One parameter over another, as "inertia/quadratic_drag"."""

    name: str
    value: float
    standard_error: float
    unit: str

    @property
    def symbols(self) -> str:
        """The same in symbols, as "I/DQ"."""
        return "/".join(_SYMBOLS[name] for name in self.name.split("/"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """Parameters with their uncertainty.

    Attributes
    ----------
    names
        In the order of ``values`` and ``covariance``.
    values, covariance
        (p,) and (p, p) in the units of ``rovid.model.parameter_names.unit_of``.
    degrees_of_freedom
        Of the residual scale behind the covariance; infinite where it was known beforehand.
    method
        One line: how it was found.
    refused
        Parameter -> why these data cannot determine it.
    warnings
        Full sentences.
    axis
        Along which they are.
    scale_doubt
        How open the scale of all thrust is, as a share, and with it that of inertia, drag and every torque. It is in
        the standard errors and intervals and not in ``covariance``: no loop and no simulation feels it.
    per_inertia
        Whether the inertia cannot be known and is taken to be 1.
    guess
        What of the vehicle that it was found with is no measurement.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    method: str
    samples: int
    degrees_of_freedom: float = float("inf")
    refused: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    axis: Axis = YAW
    thrust_scale_uncertainty: float = 0.0
    per_inertia: bool = False
    assumptions: Assumptions = field(default_factory=Assumptions)

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only(self.values))
        object.__setattr__(self, "covariance", read_only(self.covariance))

    def value(self, name: str) -> float:
        """Value of the parameter ``name``."""
        return float(self.values[self.names.index(name)])

    def standard_error(self, name: str) -> float:
        """Standard error of the parameter ``name``."""
        return math.hypot(self._spread(name), self.thrust_scale_uncertainty * self._scaled(name))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval by Student's t; what the scale of thrust leaves open is a factor, which has no sign."""
        value, chance = self.value(name), 0.5 + level / 2.0
        reach = t_quantile(chance, self.degrees_of_freedom) * self._spread(name)
        doubt = 0.0
        if self._scaled(name):
            doubt = t_quantile(chance, math.inf) * self.thrust_scale_uncertainty

        def edge(way: float) -> float:
            plain = value + way * reach
            # Beyond zero the value is not known well enough for a factor to matter.
            if doubt == 0.0 or plain * value <= 0.0:
                return plain
            spread = math.hypot(math.log(plain / value), doubt)
            return value * math.exp(math.copysign(spread, way * value))

        return edge(-1.0), edge(1.0)

    def _spread(self, name: str) -> float:
        at = self.names.index(name)
        return math.sqrt(self.covariance[at, at])

    def _scaled(self, name: str) -> float:
        """Size of what is larger with all thrust; 0 of what is not."""
        if not scales_with_thrust(unit_of(name, self.axis)):
            return 0.0
        return abs(self.value(name))

    def correlation(self, first: str, second: str) -> float:
        """Correlation between two parameters; NaN where one of them is not estimated."""
        covariance = float(self.covariance[self.names.index(first), self.names.index(second)])
        both = self._spread(first) * self._spread(second)
        return covariance / both if both > 0.0 else math.nan

    def differs_from_zero(self, name: str) -> bool:
        """Whether the 95 % interval of ``name`` leaves zero out."""
        low, high = self.interval(name)
        return low > 0.0 or high < 0.0

    def with_thrust_scale_uncertainty(self, doubt: float) -> Self:
        """The same with this ``scale_doubt``, and a word on it."""
        if doubt < _NO_DOUBT:
            return self
        warning = (
            "Inertia and drag may all be larger or smaller together: these data show how thrust departs from what it "
            "was taken for, but not at which thrust or voltage that still holds. Their standard errors include "
            f"{100 * doubt:.2g} % for that."
        )
        return replace(self, thrust_scale_uncertainty=doubt, warnings=(*self.warnings, warning))

    def undriven(self) -> Self:
        """The same of logs that nothing drives: the inertia was taken to be 1, and is refused."""
        warning = f"{UNDRIVEN[:1].upper()}{UNDRIVEN[1:]}."
        warnings = (*self.warnings, warning)
        return replace(self, refused={**self.refused, "inertia": UNDRIVEN}, per_inertia=True, warnings=warnings)

    def is_placeholder(self, name: str) -> bool:
        """Whether the parameter ``name`` hangs on a guess, so that no size of it is known."""
        return self.assumptions.is_placeholder(unit_of(name, self.axis))

    @property
    def ratios(self) -> tuple[Ratio, ...]:
        """What inertia and drag are of each other, whatever the size of thrust; of what is known from zero alone."""
        over = [self.ratio("inertia", drag) for drag in ("quadratic_drag", "linear_drag")]
        found = [ratio for ratio in over if ratio is not None]
        both = None if found else self.ratio("linear_drag", "quadratic_drag")
        return (*found, *([both] if both else []))

    def ratio(self, first: str, second: str) -> Ratio | None:
        """One parameter over another; None where either is not known, or the second cannot be told from zero."""
        known = [name for name in (first, second) if name in self.names and name not in self.refused]
        if len(known) < 2 or not self.value(second) > _FROM_ZERO * self._spread(second):
            return None
        one, other = self.names.index(first), self.names.index(second)
        value = self.value(first) / self.value(second)
        # To first order, by the covariance of both: a common factor is in neither.
        slope = np.zeros(len(self.names))
        slope[one], slope[other] = 1.0 / self.value(second), -value / self.value(second)
        spread = math.sqrt(max(float(slope @ self.covariance @ slope), 0.0))
        unit = _OVER[first, second]
        return Ratio(name=f"{first}/{second}", value=value, standard_error=spread, unit=self.axis.unit(unit))

    def unit(self, name: str) -> str:
        """Unit of the parameter ``name``."""
        unit = unit_of(name, self.axis)
        if self.per_inertia and name != "inertia" and scales_with_thrust(unit):
            return unit + PER_INERTIA
        return unit


def varies(values: FloatArray, *, noise: float = 0.0) -> bool:
    """Whether ``values`` change by more than rounding and white noise of this standard deviation would make them."""
    rounding = _ROUNDING * float(np.max(np.abs(values)))
    return bool(np.std(values) > max(noise, rounding))


def r_squared(measured: FloatArray, residuals: FloatArray) -> float:
    """R^2, 1 - SSE/SST with the mean taken away; NaN where what was measured does not vary."""
    if not varies(measured):
        return math.nan
    deviations = measured - measured.mean()
    return 1.0 - float(residuals @ residuals) / float(np.sum(deviations**2))
