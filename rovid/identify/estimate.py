"""What every identification returns: values, covariance, and what could not be determined."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from scipy import special

from rovid.axis import YAW, Axis
from rovid.model import unit_of
from rovid.trial import FloatArray, read_only


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """Parameters with their uncertainty.

    Attributes
    ----------
    names
        In the order of ``values`` and ``covariance``.
    values, covariance
        (p,) and (p, p) in the units of ``rovid.model.unit_of``.
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
        Standard deviation, as a share, of a scale that all thrust may have besides, and with it all that is a force or
        stands against one. It is in the standard errors and not in ``covariance``: no loop and no simulation feels it.
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
    scale_doubt: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only(self.values))
        object.__setattr__(self, "covariance", read_only(self.covariance))

    def value(self, name: str) -> float:
        """Value of the parameter ``name``."""
        return float(self.values[self.names.index(name)])

    def standard_error(self, name: str) -> float:
        """Standard error of the parameter ``name``."""
        at = self.names.index(name)
        unit = self.unit(name)
        scaled = abs(self.value(name)) if unit == "N" or unit.startswith(("N ", "kg")) else 0.0
        return math.hypot(math.sqrt(self.covariance[at, at]), self.scale_doubt * scaled)

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval by Student's t."""
        reach = student_t(0.5 + level / 2.0, self.degrees_of_freedom) * self.standard_error(name)
        return self.value(name) - reach, self.value(name) + reach

    def correlation(self, first: str, second: str) -> float:
        """Correlation between two parameters; NaN where one of them is not estimated."""
        a, b = self.names.index(first), self.names.index(second)
        both = math.sqrt(self.covariance[a, a] * self.covariance[b, b])
        return float(self.covariance[a, b]) / both if both > 0.0 else math.nan

    def differs_from_zero(self, name: str) -> bool:
        """Whether the 95 % interval of ``name`` leaves zero out."""
        low, high = self.interval(name)
        return low > 0.0 or high < 0.0

    def with_scale_doubt(self, doubt: float) -> Self:
        """The same with this ``scale_doubt``, and a word on it."""
        if doubt == 0.0:
            return self
        warning = (
            "Inertia and drag may all be larger or smaller together: these data show how thrust departs from the "
            "bench curve, but not at which thrust or voltage the curve still holds. Their standard errors include "
            f"{100 * doubt:.2g} % for that."
        )
        return replace(self, scale_doubt=doubt, warnings=(*self.warnings, warning))

    def unit(self, name: str) -> str:
        """Unit of the parameter ``name``."""
        return unit_of(name, self.axis)


def student_t(probability: float, degrees_of_freedom: float) -> float:
    """Quantile of Student's t; of the normal distribution for infinite degrees of freedom."""
    if np.isinf(degrees_of_freedom):
        return float(special.ndtri(probability))
    return float(special.stdtrit(degrees_of_freedom, probability))
