"""The planar model: surge, sway and yaw of a vehicle in a current. docs/planar.md, (1) to (4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import PLANAR_FORMS, Effect
from rovid.effects.base import Coupling, Values, WaterCurrent
from rovid.model.bound_effects import BoundEffect
from rovid.model.parameter_names import PLANAR_UNITS
from rovid.trial.trial import read_only

# Degrees of freedom, in the order of all vectors of forces and speeds.
AXIS_NAMES = ("surge", "sway", "yaw")
BASE_NAMES = tuple(PLANAR_UNITS)
# Names of the base parameters as SNAME (1950) derivatives: the parameter is the negative of the derivative, for the
# inertias beside the rigid body's part.
SNAME = dict(
    zip(BASE_NAMES, ("X_udot", "Y_vdot", "N_rdot", "Y_rdot", "X_u", "Y_v", "N_r", "X_uu", "Y_vv", "N_rr"), strict=True)
)
# Coefficients of the compiled loops: base parameters, parameters of each coupling, current, and of each rudder.
BASE_COUNT = len(BASE_NAMES)
COUPLINGS: tuple[Effect, ...] = tuple(form for form in PLANAR_FORMS if isinstance(form.acts, Coupling))
_COUNTS = [len(form.parameters) for form in COUPLINGS]
# Effect key -> index of its first coefficient.
COUPLING_INDEX: Mapping[str, int] = {form.key: BASE_COUNT + sum(_COUNTS[:at]) for at, form in enumerate(COUPLINGS)}
# Index of the current's north and east parts in m/s, and of its wander: standard deviation in m/s, correlation time.
CURRENT_INDEX = BASE_COUNT + sum(_COUNTS)
RUDDER_INDEX = CURRENT_INDEX + 4
# Coefficients of a rudder: position in m ahead and to starboard, lift in N s^2/m^2, stall angle in rad, slipstream in
# m^2/(N s^2).
RUDDER_COUNT = 5
# Columns of the inputs before those of the rudders (angle, thrust ahead of it): forces X, Y, N.
INPUT_COUNT = 3
RUDDER_INPUTS = 2


@dataclass(frozen=True, kw_only=True)
class RudderModel:
    """A rudder with its coefficients."""

    name: str
    position: tuple[float, float]  #: m ahead of the origin, negative at the stern, and to starboard.
    lift: float = 0.0  #: N s^2/m^2; side force over squared inflow and sine of the angle of attack.
    stall: float = 0.6  #: rad; the side force grows no further beyond this angle of attack.
    slipstream: float = 0.0  #: m^2/(N s^2); squared inflow by thrust of the propeller ahead of it.


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarModel:
    """M nu' + C(nu) nu + D(nu) nu = tau + couplings, with nu = (u, v, r) through the water."""

    base: FloatArray  #: (10,) values of `BASE_NAMES`.
    effects: tuple[BoundEffect, ...] = ()
    rudders: tuple[RudderModel, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", read_only(self.base))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in the order of ``values``."""
        of_rudders = [f"rudder.{rudder.name}.{part}" for rudder in self.rudders for part in ("lift", "slipstream")]
        of_effects = [f"{one.effect.key}.{p.name}" for one in self.effects for p in one.effect.parameters]
        return (*BASE_NAMES, *of_rudders, *of_effects)

    @property
    def values(self) -> FloatArray:
        """(p,) values of all parameters in SI."""
        of_rudders = [number for rudder in self.rudders for number in (rudder.lift, rudder.slipstream)]
        return np.concatenate((self.base, of_rudders, *(one.parameters for one in self.effects)))

    def with_values(self, values: FloatArray) -> Self:
        """The model with other (p,) ``values``."""
        rudders, effects, at = [], [], BASE_COUNT
        for rudder in self.rudders:
            rudders.append(replace(rudder, lift=float(values[at]), slipstream=float(values[at + 1])))
            at += 2
        for one in self.effects:
            count = len(one.effect.parameters)
            effects.append(BoundEffect(one.effect, np.asarray(values[at : at + count], dtype=np.float64)))
            at += count
        return replace(self, base=values[:BASE_COUNT], rudders=tuple(rudders), effects=tuple(effects))

    def value(self, name: str) -> float:
        """Value of the parameter ``name``."""
        return float(self.values[self.names.index(name)])

    @property
    def mass_matrix(self) -> FloatArray:
        """(3, 3) inertia with added mass, of surge, sway and yaw."""
        surge, sway, yaw, coupled = self.base[:4]
        return np.array([[surge, 0.0, 0.0], [0.0, sway, coupled], [0.0, coupled, yaw]])

    def effect_values(self, effect_id: str) -> Values | None:
        """Parameter values of the effect with this id, in whatever form; None without it."""
        return next((one.values for one in self.effects if one.effect.id == effect_id), None)

    @property
    def current(self) -> tuple[float, float]:
        """Current to north and to east in m/s; zeros without one."""
        north, east = self.coefficients[CURRENT_INDEX : CURRENT_INDEX + 2]
        return float(north), float(east)

    @property
    def coefficients(self) -> FloatArray:
        """(c,) coefficients of the compiled loops; see the indices of this module."""
        numbers = np.zeros(RUDDER_INDEX + RUDDER_COUNT * len(self.rudders))
        numbers[:BASE_COUNT] = self.base
        numbers[CURRENT_INDEX + 3] = 1.0
        for one in self.effects:
            if isinstance(one.effect.acts, Coupling):
                first = COUPLING_INDEX[one.effect.key]
                numbers[first : first + len(one.parameters)] = one.parameters
            elif isinstance(one.effect.acts, WaterCurrent):
                speed, direction, *wander = one.parameters.tolist()
                numbers[CURRENT_INDEX : CURRENT_INDEX + 2] = speed * np.cos(direction), speed * np.sin(direction)
                if wander:
                    numbers[CURRENT_INDEX + 2 : CURRENT_INDEX + 4] = wander
        for at, rudder in enumerate(self.rudders):
            first = RUDDER_INDEX + RUDDER_COUNT * at
            numbers[first : first + RUDDER_COUNT] = *rudder.position, rudder.lift, rudder.stall, rudder.slipstream
        return numbers

    @property
    def wanders(self) -> bool:
        """Whether the current wanders."""
        acts = (one.effect.acts for one in self.effects)
        return any(isinstance(act, WaterCurrent) and act.wanders for act in acts)

    def coriolis_matrix(self, speeds: Sequence[float]) -> FloatArray:
        """(3, 3) Coriolis and centripetal matrix of the ``mass_matrix`` (Fossen 2011, theorem 3.2)."""
        u, v, r = speeds
        momentum = self.mass_matrix @ np.array([u, v, r])
        return np.array([[0.0, 0.0, -momentum[1]], [0.0, 0.0, momentum[0]], [momentum[1], -momentum[0], 0.0]])


def log_cholesky(mass: FloatArray, scale: FloatArray) -> FloatArray:
    """(4,) unbounded coordinates of a positive definite (3, 3) ``mass`` matrix, for (3,) typical inertias ``scale``."""
    sway = 0.5 * np.log(mass[1, 1] / scale[1])
    root = np.sqrt(scale[1] * scale[2])
    coupled = mass[1, 2] / root / np.exp(sway)
    rest = max(mass[2, 2] / scale[2] - coupled**2, 1e-12)
    return np.array([np.log(mass[0, 0] / scale[0]), sway, 0.5 * np.log(rest), coupled])


def from_log_cholesky(numbers: FloatArray, scale: FloatArray) -> FloatArray:
    """(4,) inertias of surge, sway, yaw and their coupling, from the coordinates of `log_cholesky`."""
    surge, sway, yaw, coupled = numbers
    side = np.exp(sway)
    return np.array(
        [
            scale[0] * np.exp(surge),
            scale[1] * side**2,
            scale[2] * (coupled**2 + np.exp(2.0 * yaw)),
            np.sqrt(scale[1] * scale[2]) * side * coupled,
        ]
    )
