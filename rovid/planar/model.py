"""The planar model: surge, sway and yaw of a vehicle in a current. docs/planar.md, (1) to (4).

Forces of actuators act along surge, sway and yaw, after the effects between command and thrust. Thrusters give forces
that depend on the commands alone: `PlanarForces.force`. Rudders give forces that depend on the motion; `PlanarForces`
holds their angles and the thrusts in whose slipstream they stand, and the equation of motion has the rest. For a rudder
at (x, y) with the angle delta, in water in which the vehicle has the velocity (u, v, r):

    u_R = u - y r,  v_R = g (1 +- b) (v + x r)                          velocity of the rudder through the water
    a = |u_R| u_R + s max(T, 0)                                         T thrust of the propeller ahead of it
    alpha = delta + atan2(v_R, sqrt(|a|))                               angle of attack, within +-stall
    F = lift (|a| + v_R^2) sin(alpha)                                   delta changes its sign where a < 0
    X = -k F sin(delta),  Y = -F cos(delta),  N = x Y - y X

(Soeding 1998; Yasukawa and Yoshimura 2015, eqs. 7, 14, 21 and 23.) The hull and the propeller straighten the flow by g,
1 where they do not, and by a share b more where v + x r > 0, less where it is negative. ``lift``, ``slipstream`` s,
``straightening`` g, ``asymmetry`` b and ``stall`` are parameters of the model; `Rudder` holds what rovid.toml says of
them, None where nothing is known.
By momentum theory s is 2/(rho A), A the area of the propeller's disc, for the slipstream far behind the propeller, and
about two thirds of that where a rudder stands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects import PLANAR_FORMS, Effect
from rovid.effects.base import Coupling, OnCommand, SensorPlace, WaterCurrent
from rovid.model.actuator_model import ActuatorModel, CommandSeries
from rovid.model.bound_effects import BoundEffect
from rovid.model.parameter_names import PLANAR_UNITS, RUDDER_UNITS
from rovid.trial.trial import Past, Trial, read_only
from rovid.trial.vehicle import Rudder, Vehicle

# Sensors in their order. Heading in rad, unwrapped; rates and velocities over ground in body axes; north and east in m.
SENSORS = ("heading", "yaw_rate", "surge_velocity", "sway_velocity", "north", "east")
# Degrees of freedom, in the order of all vectors of forces and speeds.
AXIS_NAMES = ("surge", "sway", "yaw")
# Sensors of these speeds.
AXIS_SPEEDS = ("surge_velocity", "sway_velocity", "yaw_rate")
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
# Index of the places ahead and to starboard in m of the velocity log, and of the antenna.
PLACE_INDEX = CURRENT_INDEX + 4
RUDDER_INDEX = PLACE_INDEX + 4
# Coefficients of a rudder: position in m ahead and to starboard, lift in N s^2/m^2, stall angle in rad, slipstream in
# m^2/(N s^2), straightening and its asymmetry, and resistance.
RUDDER_COUNT = 8
# Columns of the inputs before those of the rudders (angle, thrust ahead of it): forces X, Y, N.
INPUT_COUNT = 3
RUDDER_INPUTS = 2
# Effects of time, which act on angles as on thrusts: they have no parameter in the unit of a command or of a thrust.
_OF_TIME = ("clock_offset", "command_delay", "thruster_lag")
# Changes of thrusters' commands over those of angles, below which a vehicle is steered by angles.
_STEERED = 0.05
# Longest part in s of an interval within which thrust is held, and most parts of one interval.
_PART, _MOST_PARTS = 0.02, 8


def is_of_actuators(effect: Effect) -> bool:
    """Whether an effect of the planar model acts between command and thrust."""
    return not isinstance(effect.acts, Coupling | WaterCurrent | SensorPlace)


@dataclass(frozen=True, kw_only=True)
class RudderModel:
    """A rudder with its coefficients."""

    name: str
    position: tuple[float, float]  #: m ahead of the origin, negative at the stern, and to starboard.
    lift: float = 0.0  #: N s^2/m^2; side force over squared inflow and sine of the angle of attack.
    stall: float = 0.6  #: rad; the side force grows no further beyond this angle of attack.
    stalls: bool = False  #: Whether that angle is a parameter.
    slipstream: float = 0.0  #: m^2/(N s^2); squared inflow by thrust of the propeller ahead of it.
    resistance: float | None = None  #: Resistance over that of a force normal to the blade; None where it is 1.
    straightening: float | None = None  #: Share of the flow aside at the rudder; None where it is no parameter, for 1.
    asymmetry: float = 0.0  #: Share by which it is larger in a flow to port than on average, and smaller to starboard.

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parameters."""
        left_out = {part for part in ("resistance", "straightening") if getattr(self, part) is None}
        left_out |= ({"asymmetry"} if self.straightening is None else set()) | (set() if self.stalls else {"stall"})
        return tuple(part for part in RUDDER_UNITS if part not in left_out)

    @property
    def values(self) -> list[float]:
        """Values of the ``parts``."""
        return [getattr(self, part) for part in self.parts]


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
        of_rudders = [f"rudder.{rudder.name}.{part}" for rudder in self.rudders for part in rudder.parts]
        of_effects = [name for one in self.effects for name in one.effect.parameter_names]
        return (*BASE_NAMES, *of_rudders, *of_effects)

    @property
    def values(self) -> FloatArray:
        """(p,) values of all parameters in SI."""
        of_rudders = [number for rudder in self.rudders for number in rudder.values]
        return np.concatenate((self.base, of_rudders, *(one.parameters for one in self.effects)))

    def with_values(self, values: FloatArray) -> Self:
        """The model with other (p,) ``values``."""
        rudders, effects, at = [], [], BASE_COUNT
        for rudder in self.rudders:
            end = at + len(rudder.parts)
            rudders.append(replace(rudder, **dict(zip(rudder.parts, values[at:end].tolist(), strict=True))))
            at = end
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

    @property
    def current(self) -> tuple[float, float]:
        """Current to north and to east in m/s; zeros without one."""
        north, east = self.coefficients[CURRENT_INDEX : CURRENT_INDEX + 2]
        return float(north), float(east)

    def place_of(self, sensor: str) -> tuple[float, float]:
        """Place in m ahead and to starboard of a velocity log or an antenna, by the name of its sensor."""
        first = PLACE_INDEX + 2 * (sensor in {"north", "east"})
        ahead, starboard = self.coefficients[first : first + 2]
        return float(ahead), float(starboard)

    def places(self, sensors: Sequence[str]) -> tuple[float, float, float, float]:
        """Places in m, ahead and to starboard, of the speeds and of the positions in logs with these ``sensors``.

        Speeds without a velocity log come from the positions: they are those of the antenna.
        """
        antenna, log = map(self.place_of, ("north", "surge_velocity"))
        x, y = (log if name in sensors else antenna for name in ("sway_velocity", "surge_velocity"))
        return x[0], y[1], *antenna

    @property
    def of_vehicle(self) -> Self:
        """The model with its sensors at the origin."""
        kept = tuple(one for one in self.effects if not isinstance(one.effect.acts, SensorPlace))
        return replace(self, effects=kept)

    @property
    def actuator_effects(self) -> tuple[BoundEffect, ...]:
        """Effects between command and thrust."""
        return tuple(one for one in self.effects if is_of_actuators(one.effect))

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
                numbers[CURRENT_INDEX + 2 : CURRENT_INDEX + 2 + len(wander)] = wander
            elif isinstance(one.effect.acts, SensorPlace):
                first = PLACE_INDEX + 2 * ("north" in one.effect.acts.sensors)
                numbers[first : first + 2] = one.parameters
        for at, rudder in enumerate(self.rudders):
            first = RUDDER_INDEX + RUDDER_COUNT * at
            of_flow = rudder.slipstream, rudder.straightening, rudder.asymmetry
            own = rudder.lift, rudder.stall, *of_flow, rudder.resistance
            numbers[first : first + RUDDER_COUNT] = [*rudder.position, *(1.0 if one is None else one for one in own)]
        return numbers

    @property
    def wanders(self) -> bool:
        """Whether the current wanders."""
        return any(getattr(one.effect.acts, "wanders", False) for one in self.effects)

    def coriolis_matrix(self, speeds: Sequence[float]) -> FloatArray:
        """(3, 3) Coriolis and centripetal matrix of the ``mass_matrix`` (Fossen 2011, theorem 3.2)."""
        u, v, r = speeds
        momentum = self.mass_matrix @ np.array([u, v, r])
        return np.array([[0.0, 0.0, -momentum[1]], [0.0, 0.0, momentum[0]], [momentum[1], -momentum[0], 0.0]])


@dataclass(frozen=True, eq=False)
class PlanarForces:
    """Means from each of n instants to the next; the last value is held."""

    force: FloatArray  #: (n, 3) N, N, N m; of all thrusters along surge, sway and yaw.
    angle: FloatArray  #: (n, p) rad; of each rudder.
    slipstream_thrust: FloatArray  #: (n, p) N; of the thruster ahead of each rudder, zero for a free rudder.

    @property
    def inputs(self) -> FloatArray:
        """(n, 3 + 2 p) inputs of the equations: the angle of each rudder is followed by the thrust ahead of it."""
        pairs = np.stack((self.angle, self.slipstream_thrust), axis=2).reshape(len(self.force), -1)
        return np.ascontiguousarray(np.hstack((self.force, pairs)), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class PlanarActuators:
    """The actuators of a vehicle, sorted into thrusters, azimuth angles and rudders."""

    vehicle: Vehicle
    #: Whether the vehicle is steered by its angles, with thrusters that hardly change: effects on commands, such as a
    #: slew limit, then act on the angles and have parameters in rad. Otherwise they act on the thrusters.
    steered: bool = False

    @classmethod
    def of(cls, vehicle: Vehicle, trials: Sequence[Trial]) -> Self:
        """The actuators of ``vehicle``, as they are used in ``trials``."""
        changes = sum(np.count_nonzero(np.diff(trial.commands, axis=0), axis=0) for trial in trials)
        is_angle = np.array([one.is_angle for one in vehicle.thrusters])
        return cls(vehicle, steered=bool(np.sum(changes * ~is_angle) < _STEERED * np.sum(changes * is_angle)))

    @cached_property
    def thruster_columns(self) -> IntArray:
        """(k,) columns of ``Trial.commands`` that command thrust."""
        return np.flatnonzero([not one.is_angle for one in self.vehicle.thrusters])

    @cached_property
    def angle_columns(self) -> IntArray:
        """(a,) columns of ``Trial.commands`` that are azimuth or rudder angles."""
        return np.flatnonzero([one.is_angle for one in self.vehicle.thrusters])

    @cached_property
    def thrusters(self) -> Vehicle:
        """The vehicle with its k thrusters alone."""
        return self._with(self.thruster_columns)

    @cached_property
    def angles(self) -> Vehicle:
        """The vehicle with its azimuth and rudder angles alone; the "thrust" of each is the angle in rad."""
        vehicle = self._with(self.angle_columns)
        # Unwrapped angles have no limit.
        return replace(vehicle, thrusters=tuple(replace(one, max_logged_torque=np.inf) for one in vehicle.thrusters))

    def _with(self, columns: IntArray) -> Vehicle:
        return replace(self.vehicle, thrusters=tuple(self.vehicle.thrusters[at] for at in columns.tolist()))

    @cached_property
    def matrix(self) -> FloatArray:
        """(3, k) force along surge and sway, and torque in yaw, of 1 N of each thruster at the azimuth 0."""
        rows = [(one.surge_share, one.sway_share, one.arm) for one in self.thrusters.thrusters]
        return np.array(rows, dtype=np.float64).reshape(-1, 3).T

    @cached_property
    def rudders(self) -> tuple[Rudder, ...]:
        """(p,) the rudders, in the order of `PlanarForces.angle`."""
        return tuple(one.rudder for one in self.angles.thrusters if one.rudder is not None)

    @cached_property
    def rudder_names(self) -> tuple[str, ...]:
        """(p,) names of the rudders."""
        return tuple(one.name for one in self.angles.thrusters if one.rudder is not None)

    @cached_property
    def _behind(self) -> list[int]:
        """(p,) number of the thruster ahead of each rudder; -1 for none."""
        names = [one.name for one in self.thrusters.thrusters]
        return [names.index(one.behind) if one.behind else -1 for one in self.rudders]

    @cached_property
    def _turned(self) -> list[tuple[int, int]]:
        """Number of each thruster that has an azimuth, and of that angle among the angles."""
        names = [one.name for one in self.thrusters.thrusters]
        return [(names.index(one.turns), at) for at, one in enumerate(self.angles.thrusters) if one.turns]

    def _is_of_steering(self, one: BoundEffect) -> bool:
        is_steering = self.steered and not _is_of_time(one)
        return isinstance(one.effect.acts, OnCommand) and (is_steering or one.effect.acts.of_angles)

    def forces(self, commands: "PlanarCommands", effects: Sequence[BoundEffect] = ()) -> PlanarForces:
        """Forces of one trial, with the ``effects`` between command and thrust.

        Effects of time (delay, lag, clock offset) act on angles, too. Forms of angles act on these alone, and so do
        effects on commands where the vehicle is ``steered``. All others act on thrusters alone.
        """
        on_angles = [one for one in effects if _is_of_time(one) or self._is_of_steering(one)]
        on_thrusts = [one for one in effects if not self._is_of_steering(one)]
        thrusts, angles = ActuatorModel(tuple(on_thrusts)), ActuatorModel(tuple(on_angles))
        # Thrusts that are needed by themselves, and the rows of forces that any other thruster drives.
        alone = sorted({number for number, _ in self._turned} | {at for at in self._behind if at >= 0})
        fixed = self.matrix.copy()
        fixed[:, [number for number, _ in self._turned]] = 0.0
        driven = np.flatnonzero(fixed.any(axis=1)).tolist()
        weights = [*fixed[driven], *np.eye(fixed.shape[1])[alone]]
        found = thrusts.mean_forces(commands.series(_parts(thrusts), angles=False), weights)
        force = np.zeros((commands.count, 3))
        for axis, series in zip(driven, found, strict=False):
            force[:, axis] = series
        thrust = dict(zip(alone, found[len(driven) :], strict=True))
        angle = np.zeros((commands.count, 0))
        if len(self.angle_columns):
            of_angles = commands.series(_parts(angles), angles=True)
            angle = _columns(angles.mean_forces(of_angles, list(np.eye(len(self.angle_columns)))), commands.count)
            # Azimuth angles are slow beside thrust: their means turn the mean thrust.
            for number, at in self._turned:
                force += _turned_force(self.thrusters, number, thrust[number], angle[:, at])
        is_rudder = [one.rudder is not None for one in self.angles.thrusters]
        behind = [thrust[at] if at >= 0 else np.zeros(commands.count) for at in self._behind]
        return PlanarForces(force, angle[:, is_rudder], _columns(behind, commands.count))


class PlanarCommands:
    """The commands of one trial, of thrusters and of angles, kept for all models that are compared."""

    def __init__(self, actuators: PlanarActuators, trial: Trial) -> None:
        self.count = len(trial.time)
        self._actuators = actuators
        self._interval = float(np.median(np.diff(trial.time)))
        self._thrusts = _with_columns(trial, actuators.thruster_columns)
        self._angles = _with_columns(trial, actuators.angle_columns, unwrapped=True)
        self._known: dict[tuple[bool, int], CommandSeries] = {}

    def series(self, parts: int, *, angles: bool) -> CommandSeries:
        """Commands of the thrusters, or of the ``angles``, with each interval in at most so many ``parts``."""
        parts = max(1, min(parts, int(np.ceil(self._interval / _PART))))
        if (angles, parts) not in self._known:
            vehicle = self._actuators.angles if angles else self._actuators.thrusters
            trial = self._angles if angles else self._thrusts
            self._known[angles, parts] = CommandSeries.from_trials(vehicle, [trial], parts)
        return self._known[angles, parts]


def _is_of_time(one: BoundEffect) -> bool:
    # The other forms of a lag have a reference thrust.
    return one.effect.id in _OF_TIME and one.effect.form in {"", "command", "double"}


def _parts(model: ActuatorModel) -> int:
    return 1 if model.has_exact_means else min(model.subdivision, _MOST_PARTS)


def _columns(series: Sequence[FloatArray], count: int) -> FloatArray:
    return np.column_stack(series) if series else np.zeros((count, 0))


def _with_columns(trial: Trial, columns: IntArray, *, unwrapped: bool = False) -> Trial:
    """``trial`` with some columns of its commands, before its first instant, too."""
    past = trial.past
    before = np.zeros((0, len(columns))) if past is None else past.commands[:, columns]
    commands = np.concatenate((before, trial.commands[:, columns]))
    if unwrapped and commands.size:
        commands = np.unwrap(commands, axis=0)
    if past is not None:
        past = Past(time=past.time, commands=commands[: len(before)], estimated=past.estimated)
    return replace(trial, commands=commands[len(before) :], past=past)


def _turned_force(vehicle: Vehicle, number: int, thrust: FloatArray, azimuth: FloatArray) -> FloatArray:
    """(n, 3) force of a thruster with (n,) ``thrust`` in N at (n,) ``azimuth`` in rad."""
    one = vehicle.thrusters[number]
    x, y = one.position or (0.0, 0.0)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    ahead = one.surge_share * cos - one.sway_share * sin
    starboard = one.surge_share * sin + one.sway_share * cos
    turned = np.column_stack((ahead, starboard, x * starboard - y * ahead))
    return np.asarray(thrust[:, None] * turned)
