"""Result of every estimation method: values, covariance, and what the data cannot determine."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.stats import t_quantile
from rovid.model.parameter_names import unit_of
from rovid.trial.assumptions import Assumptions, scales_with_thrust, thrust_exponent
from rovid.trial.axis import YAW, Axis
from rovid.trial.trial import read_only

# Suffix of the units of torques and drags where the inertia is unknown.
PER_INERTIA = " per kg m^2"
UNDRIVEN = (
    "no actuator drives the vehicle in these logs, so the inertia cannot be determined: every torque and drag is per "
    "kg m^2 of it"
)
# Relative uncertainty of the thrust scale below which no warning is given.
_NEGLIGIBLE_SCALE_ERROR = 1e-3
# Relative size of rounding errors of a constant series.
_ROUNDING = 1e-9
# Least number of standard errors from zero of a divisor.
_DIVISOR_SIGMAS = 3.0
_SYMBOLS = {"inertia": "I", "quadratic_drag": "DQ", "linear_drag": "DL"}
_RATIO_UNITS = {
    ("inertia", "quadratic_drag"): "rad",
    ("inertia", "linear_drag"): "s",
    ("linear_drag", "quadratic_drag"): "rad/s",
}


@dataclass(frozen=True, kw_only=True)
class Ratio:
    """Ratio of two parameters, named as "inertia/quadratic_drag"."""

    name: str
    value: float
    standard_error: float
    unit: str

    @property
    def symbols(self) -> str:
        """The ratio in symbols, as "I/DQ"."""
        return "/".join(_SYMBOLS[name] for name in self.name.split("/"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """Parameters with their uncertainty."""

    names: tuple[str, ...]  #: In the order of ``values`` and ``covariance``.
    #: ``values``, ``covariance``: (p,) and (p, p) in the units of ``rovid.model.parameter_names.unit_of``.
    values: FloatArray
    covariance: FloatArray
    method: str  #: One line on the method.
    samples: int
    #: Of the residual variance behind the covariance; infinite where it was known beforehand.
    degrees_of_freedom: float = float("inf")
    refused: Mapping[str, str] = field(default_factory=dict)  #: Parameter -> why these data cannot determine it.
    warnings: tuple[str, ...] = ()  #: Full sentences.
    axis: Axis = YAW  #: Degree of freedom of the parameters.
    #: Relative standard error of the scale of all thrust, and with it of inertia, drag and every torque. Standard
    #: errors and intervals include it. ``covariance`` does not, because no simulation or control loop depends on it.
    thrust_scale_uncertainty: float = 0.0
    per_inertia: bool = False  #: Whether the inertia cannot be determined and is taken to be 1.
    #: Placeholder values in the vehicle's configuration that the estimate depends on.
    assumptions: Assumptions = field(default_factory=Assumptions)
    from_prior: tuple[str, ...] = ()  #: Parameters that a prior decides, and not the data.
    lacks_torque: bool = False  #: Whether prediction errors show a torque that the model lacks; docs/method.md, (15a).

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only(self.values))
        object.__setattr__(self, "covariance", read_only(self.covariance))

    def only(self, names: Sequence[str]) -> Self:
        """The estimate of the parameters ``names`` alone."""
        at = list(map(self.names.index, names))
        return replace(self, names=tuple(names), values=self.values[at], covariance=self.covariance[np.ix_(at, at)])

    def value(self, name: str) -> float:
        """Value of the parameter ``name``."""
        return float(self.values[self.names.index(name)])

    def standard_error(self, name: str) -> float:
        """Standard error of the parameter ``name``."""
        return math.hypot(self._covariance_error(name), self._scale_error(name) * self.value(name))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval by Student's t; the uncertainty of the thrust scale is a factor on the value."""
        value, quantile = self.value(name), 0.5 + level / 2.0
        reach = t_quantile(quantile, self.degrees_of_freedom) * self._covariance_error(name)
        log_error = t_quantile(quantile, math.inf) * self._scale_error(name)

        def edge(sign: float) -> float:
            plain = value + sign * reach
            # An interval that includes zero is so wide that a factor does not matter.
            if log_error == 0.0 or plain * value <= 0.0:
                return plain
            return value * math.exp(math.copysign(math.hypot(math.log(plain / value), log_error), sign * value))

        return edge(-1.0), edge(1.0)

    def _covariance_error(self, name: str) -> float:
        at = self.names.index(name)
        return math.sqrt(self.covariance[at, at])

    def _scale_error(self, name: str) -> float:
        """Relative error of a parameter by that of the thrust scale."""
        return self.thrust_scale_uncertainty * abs(thrust_exponent(unit_of(name, self.axis)))

    def correlation(self, first: str, second: str) -> float:
        """Correlation between two parameters; NaN where one of them is not estimated."""
        covariance = float(self.covariance[self.names.index(first), self.names.index(second)])
        both = self._covariance_error(first) * self._covariance_error(second)
        return covariance / both if both > 0.0 else math.nan

    def differs_from_zero(self, name: str) -> bool:
        """Whether the 95 % interval of ``name`` excludes zero."""
        low, high = self.interval(name)
        return low > 0.0 or high < 0.0

    def with_thrust_scale_uncertainty(self, uncertainty: float) -> Self:
        """The estimate with this relative ``thrust_scale_uncertainty``, and a warning of it."""
        if uncertainty < _NEGLIGIBLE_SCALE_ERROR:
            return self
        warning = (
            "Inertia and drag may all be larger or smaller by one factor: these data show how the thrust curve bends, "
            "but not at which thrust or voltage the bench value holds. Their standard errors include "
            f"{100 * uncertainty:.2g} % for that."
        )
        return replace(self, thrust_scale_uncertainty=uncertainty, warnings=(*self.warnings, warning))

    def with_assumptions(self, assumptions: Assumptions, scale_error: float = 0.0) -> Self:
        """The estimate with the vehicle's guesses, marked in its warnings, and a relative error of its thrust scale."""
        return replace(
            self,
            assumptions=assumptions,
            warnings=tuple(map(assumptions.mark_sentence, self.warnings)),
            thrust_scale_uncertainty=math.hypot(self.thrust_scale_uncertainty, scale_error),
        )

    def normalised_by_inertia(self) -> Self:
        """The estimate for logs without actuators: the inertia was taken to be 1 and is refused."""
        warnings = (*self.warnings, f"{UNDRIVEN[:1].upper()}{UNDRIVEN[1:]}.")
        return replace(self, refused={**self.refused, "inertia": UNDRIVEN}, per_inertia=True, warnings=warnings)

    def is_placeholder(self, name: str) -> bool:
        """Whether the size of the parameter ``name`` depends on a placeholder value."""
        return self.assumptions.is_placeholder(unit_of(name, self.axis))

    @property
    def ratios(self) -> tuple[Ratio, ...]:
        """Determined ratios between inertia and drags, which do not depend on the thrust scale."""
        to_inertia = self.ratio("inertia", "quadratic_drag"), self.ratio("inertia", "linear_drag")
        return tuple(filter(None, to_inertia)) or tuple(filter(None, [self.ratio("linear_drag", "quadratic_drag")]))

    def ratio(self, first: str, second: str) -> Ratio | None:
        """Ratio of two parameters; None where either is undetermined or the second is near zero."""
        known = [name for name in (first, second) if name in self.names and name not in self.refused]
        if len(known) < 2 or not self.value(second) > _DIVISOR_SIGMAS * self._covariance_error(second):
            return None
        one, other = self.names.index(first), self.names.index(second)
        value = self.value(first) / self.value(second)
        # First-order error propagation. A common factor cancels.
        slope = np.zeros(len(self.names))
        slope[one], slope[other] = 1.0 / self.value(second), -value / self.value(second)
        error = math.sqrt(max(float(slope @ self.covariance @ slope), 0.0))
        unit = self.axis.unit(_RATIO_UNITS[first, second])
        return Ratio(name=f"{first}/{second}", value=value, standard_error=error, unit=unit)

    def unit(self, name: str) -> str:
        """Unit of the parameter ``name``."""
        unit = unit_of(name, self.axis)
        if self.per_inertia and name != "inertia" and scales_with_thrust(unit):
            return unit + PER_INERTIA
        return unit


def varies(values: FloatArray, *, noise: float = 0.0) -> bool:
    """Whether ``values`` change by more than rounding and white noise of this standard deviation."""
    rounding = _ROUNDING * float(np.max(np.abs(values)))
    return bool(np.std(values) > max(noise, rounding))


def r_squared(measured: FloatArray, residuals: FloatArray) -> float:
    """R^2 = 1 - SSE/SST about the mean; NaN where the measured values do not vary. docs/method.md, (17)."""
    if not varies(measured):
        return math.nan
    deviations = measured - measured.mean()
    return 1.0 - float(residuals @ residuals) / float(np.sum(deviations**2))
