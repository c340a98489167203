"""Input and result of the exporters of the coupled model, its commands for verification, and rovid's own motion."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import neutral_commands
from rovid.effects.base import Coupling, WaterCurrent
from rovid.export.body_equation import BodyEquation
from rovid.export.interface import PERIOD, ExportInput
from rovid.export.resimulation import first_order_lag, repeat_held
from rovid.export.thruster_curves import (
    COMMAND_LAG,
    NO_LAG,
    THRUST_LAG,
    ThrusterCurve,
    ThrusterLag,
    curve_effect_keys,
    thruster_curves,
)
from rovid.model.model import Model
from rovid.planar.dataset import PlanarData
from rovid.planar.free_runs import PlanarMotion, simulate_planar
from rovid.planar.model import AXIS_SPEEDS, PlanarActuators, PlanarCommands, PlanarModel
from rovid.store.parameter_file import Entry, Parameters
from rovid.store.planar_study import PlanarStudy, planar_model
from rovid.trial.assumptions import Assumptions
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Thruster, Vehicle

_STAND_IN_MASS = 1.0
# Largest speeds in m/s and rad/s without logs.
_ASSUMED = (1.0, 0.5, 0.3)
# Sections of the verification: shares of the largest command ahead, to starboard and in turn, for one length each.
_SECTIONS = (
    (0.0, 0.0, 0.0),
    (1.0, 0.0, 0.0),
    (0.0, 0.0, 0.0),
    (0.0, 1.0, 0.0),
    (0.0, 0.0, 1.0),
    (0.0, 0.0, 0.0),
    (0.7, 0.0, 0.5),
    (0.7, 0.0, -0.5),
    (0.5, -0.5, 0.3),
    (-0.7, 0.0, 0.0),
    (0.0, 0.0, -0.7),
    (0.0, 0.0, 0.0),
)
# Length of a section in time constants of the slowest motion, and range of that time constant in s.
_LENGTH, _SLOWEST = 2.0, (1.0, 30.0)
# rad, largest angle of a rudder or of an azimuth thruster in the verification.
_LARGEST_ANGLE = math.pi / 4.0
# Number of bisections for the amplitude.
_BISECTIONS = 8


class ThrusterUnit(NamedTuple):
    """A thruster in a simulator: it pushes from a place along a direction."""

    curve: ThrusterCurve
    x: float  #: m ahead.
    y: float  #: m to starboard.
    direction: float  #: rad, 0 ahead, positive to starboard.


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarInput:
    """Coupled model and vehicle to export."""

    model: PlanarModel
    vehicle: Vehicle
    entries: Mapping[str, Entry]  #: Parameters with units and standard errors.
    envelope: FloatArray  #: (3,) largest speeds in m/s and rad/s in the logs.
    commands: FloatArray  #: (k, 2) smallest and largest command of each actuator in the logs.
    notes: tuple[str, ...] = ()
    guess: Assumptions = field(default_factory=Assumptions)

    @cached_property
    def actuators(self) -> PlanarActuators:
        """The actuators."""
        return PlanarActuators(self.vehicle)

    @property
    def effects(self) -> Mapping[str, Mapping[str, float]]:
        """Parameters of each effect, by the key of the effect."""
        return {one.effect.key: dict(one.values) for one in self.model.effects}

    def with_effects(self, keys: frozenset[str]) -> PlanarModel:
        """The model with only these effects."""
        return replace(self.model, effects=tuple(one for one in self.model.effects if one.effect.key in keys))

    @cached_property
    def thrusters(self) -> ExportInput:
        """The thrusters alone, as input of the functions for thrust curves; angles excluded."""
        own = [one for one in self.model.effects if not isinstance(one.effect.acts, Coupling | WaterCurrent)]
        values = [float(value) for one in own for value in one.parameters]
        entries = {
            f"{one.effect.key}.{name}": Entry(value=value, standard_error=math.nan, unit="", method="")
            for one in own
            for name, value in one.values.items()
        }
        model = Model(
            inertia=1.0,
            quadratic_drag=0.0,
            linear_drag=0.0,
            effects=tuple(one.effect for one in own),
            effect_values=tuple(values),
        )
        return ExportInput(
            model=model,
            vehicle=self.actuators.thrusters,
            entries=entries,
            largest_rate=float(self.envelope[2]),
            commands=self.commands[self.actuators.thruster_columns],
            reference={},
        )

    @cached_property
    def curves(self) -> list[ThrusterCurve]:
        """Thrust curve of each thruster."""
        return thruster_curves(self.thrusters)

    @property
    def curve_keys(self) -> frozenset[str]:
        """Keys of the effects that a thrust curve represents."""
        return curve_effect_keys(self.thrusters)

    @cached_property
    def units(self) -> list[ThrusterUnit]:
        """Thrusters with places. A yaw torque without a known force becomes a pair of opposite lateral thrusters."""
        found = []
        for curve, thruster in zip(self.curves, self.actuators.thrusters.thrusters, strict=True):
            ahead, side, arm = thruster.surge_share, thruster.sway_share, thruster.arm
            size = math.hypot(ahead, side)
            if size == 0.0:
                for sign, suffix in ((1.0, "_a"), (-1.0, "_b")):
                    half = replace(curve, thrust=0.5 * curve.thrust, identifier=curve.identifier + suffix)
                    found.append(ThrusterUnit(half, sign * arm, 0.0, sign * math.pi / 2.0))
                continue
            # The point of the line of thrust that is closest to the origin, where the place is not known.
            x, y = thruster.position or (arm * side / size**2, -arm * ahead / size**2)
            scaled = replace(curve, thrust=size * curve.thrust)
            found.append(ThrusterUnit(scaled, x, y, math.atan2(side, ahead)))
        return found

    @property
    def mass(self) -> float:
        """Mass in kg of the rigid body; the smaller inertia of surge and sway if not known or larger than that."""
        largest = float(min(self.model.base[:2]))
        if self.vehicle.mass is None or self.vehicle.mass > largest:
            return largest
        return self.vehicle.mass

    @property
    def rigid_inertia(self) -> float:
        """Inertia of the rigid body in yaw in kg m^2; all of it if not known or larger than that."""
        largest = float(self.model.base[2])
        known = self.vehicle.rigid_body_inertia
        return largest if known is None or known > largest else known

    @property
    def own_damping(self) -> tuple[FloatArray, FloatArray]:
        """(3, 3) linear and (3, 3, 3) absolute damping of each axis by its own velocity; see `BodyEquation`."""
        absolute = np.zeros((3, 3, 3))
        for axis in range(3):
            absolute[axis, axis, axis] = self.model.base[7 + axis]
        return np.diag(self.model.base[4:7]), absolute

    @cached_property
    def damping(self) -> tuple[FloatArray, FloatArray, frozenset[str]]:
        """Linear and absolute damping with that of effects, and the keys of these effects."""
        linear, absolute = self.own_damping
        kept = set()
        for key, values in self.effects.items():
            if key == "sway_yaw_damping":
                linear[2, 1] += values["yaw_by_sway"]
                linear[1, 2] += values["sway_by_yaw"]
            elif key == "sway_yaw_damping:lift":
                absolute[2, 1, 0] += values["yaw_by_sway"]
                absolute[1, 2, 0] += values["sway_by_yaw"]
            elif key == "speed_dependent_damping:planar":
                absolute[2, 2, 0] += values["yaw"]
                absolute[1, 1, 0] += values["sway"]
            else:
                continue
            kept.add(key)
        return linear, absolute, frozenset(kept)

    @property
    def bias(self) -> FloatArray:
        """(3,) constant forces in N and N m."""
        values = self.effects.get("bias_torque:planar", {})
        return np.array([values.get(name, 0.0) for name in ("surge", "sway", "yaw")])

    def commands_at(self, shares: FloatArray) -> FloatArray:
        """(n, k) commands of (n, 3) shares of the largest ones ahead, to starboard and in turn; angles follow turn."""
        columns = []
        pairs = zip(self.vehicle.thrusters, neutral_commands(self.vehicle), self.commands, strict=True)
        for thruster, neutral, ends in pairs:
            if thruster.is_angle:
                columns.append(shares[:, 2] * min(float(np.max(np.abs(ends))), _LARGEST_ANGLE))
                continue
            levers = np.array([thruster.surge_share, thruster.sway_share, thruster.arm])
            mixed = np.clip(shares @ np.sign(np.where(np.abs(levers) > 1e-9, levers, 0.0)), -1.0, 1.0)
            thrust = ends if thruster.curve is None else thruster.curve(ends)
            low, high = ends[np.argsort(thrust, kind="stable")]
            columns.append(np.interp(mixed, [-1.0, 0.0, 1.0], [low, neutral, high]))
        return np.column_stack(columns)


def planar_input(stored: Parameters, study: PlanarStudy | None) -> PlanarInput:
    """Input from a parameter file and, if they exist, from the logs behind it.

    Raises ConfigError if a parameter is missing.
    """
    notes = []
    if stored.assumed:
        names = ", ".join(stored.assumed)
        notes.append(
            f"The logs do not determine {names}: stand-ins are written, which they neither support nor refute."
        )
    if study is None:
        model = planar_model(stored)
        envelope = np.array(_ASSUMED)
        largest = model.base[4:7] * envelope + model.base[7:10] * envelope**2
        thrusters = tuple(
            Thruster(name=f"{name}_force", arm=shares[2], curve=None, surge_share=shares[0], sway_share=shares[1])
            for name, shares in (("surge", (1.0, 0.0, 0.0)), ("sway", (0.0, 1.0, 0.0)), ("yaw", (0.0, 0.0, 1.0)))
        )
        notes.append(
            "There are no logs of the vehicle and its thrusters. Forces along the three axes are the commands, and "
            f"largest speeds of {_ASSUMED[0]:g} m/s, {_ASSUMED[1]:g} m/s and {_ASSUMED[2]:g} rad/s are assumed."
        )
        return PlanarInput(
            model=model,
            vehicle=Vehicle(name=stored.vehicle or "vehicle", thrusters=thrusters, planar=True),
            entries=stored.entries,
            envelope=envelope,
            commands=np.column_stack((-largest, largest)),
            notes=tuple(notes),
        )
    model, data = study.model(stored), study.data
    commands = np.concatenate([run.trial.commands for run in data.runs])
    return PlanarInput(
        model=model,
        vehicle=data.vehicle,
        entries=stored.entries,
        envelope=largest_speeds(model, data),
        commands=np.column_stack([np.nanmin(commands, axis=0), np.nanmax(commands, axis=0)]),
        notes=tuple(notes),
    )


def largest_speeds(model: PlanarModel, data: PlanarData) -> FloatArray:
    """(3,) largest speeds in the logs: measured ones where there are any, else those of the simulated runs."""
    sizes = np.zeros(3)
    for run in data.runs:
        motion = None
        for axis, name in enumerate(AXIS_SPEEDS):
            if name in run.sensors:
                # Single wild readings are no speeds of the vehicle.
                size = float(np.quantile(np.abs(run.readings(name).values), 0.999))
            else:
                motion = motion or simulate_planar(model, run)
                size = float(np.max(np.abs(motion.sensor(name))))
            sizes[axis] = max(sizes[axis], size)
    return sizes


def verification_shares(subject: PlanarInput) -> FloatArray:
    """(n, 3) shares for `PERIOD` each: along each axis, combined, and at rest, within the speeds of the logs."""
    model = subject.model
    slopes = model.base[4:7] + model.base[7:10] * np.maximum(subject.envelope, 1e-3)
    slowest = float(np.max(model.base[:3] / np.maximum(slopes, 1e-9)))
    count = round(_LENGTH * min(max(slowest, _SLOWEST[0]), _SLOWEST[1]) / PERIOD)
    shares = np.repeat(np.array(_SECTIONS), count, axis=0)

    def stays_within(factor: float) -> bool:
        speeds = rovid_motion(subject, subject.model, subject.commands_at(factor * shares))[:, 1:]
        return bool(np.all(np.max(np.abs(speeds), axis=0) <= np.maximum(subject.envelope, 1e-9)))

    if stays_within(1.0):
        return shares
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stays_within(middle) else (low, middle)
    # A bias or a current alone may exceed the envelope.
    return max(low, 0.05) * shares


def rovid_motion(subject: PlanarInput, model: PlanarModel, commands: FloatArray) -> FloatArray:
    """(n, 4) heading and velocities over ground of ``model``, from rest under (n, k) ``commands`` for `PERIOD` each."""
    time = PERIOD * np.arange(len(commands), dtype=np.float64)
    trial = Trial.from_commands(time, commands)
    actuators = subject.actuators
    inputs = actuators.forces(PlanarCommands(actuators, trial), model.actuator_effects).inputs
    scale = np.maximum(subject.envelope, 1e-3)
    motion = PlanarMotion.simulated(model, np.array([0, len(time)]), time, inputs, np.zeros((1, 6)), scale)
    return np.column_stack(list(map(motion.sensor, ("heading", *AXIS_SPEEDS))))


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarExportResult:
    """Content of an exported file, and the simulator's equation with the numbers in it."""

    content: str | bytes
    equation: BodyEquation
    #: (n, k) commands, each held for `PERIOD` -> (n, 4) heading and velocities over ground at the beginning of each.
    simulate: Callable[[FloatArray], FloatArray]
    kept_effects: frozenset[str]  #: Keys of the effects that the file represents.
    keeps_angles: bool = False  #: Whether the file represents rudders and azimuth angles.
    #: (parameter, reason) of the parts of the base model that the file cannot represent.
    base_losses: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()


def simulation(
    subject: PlanarInput, equation: BodyEquation, units: Sequence[ThrusterUnit], lag: ThrusterLag = NO_LAG
) -> Callable[[FloatArray], FloatArray]:
    """Simulation of ``equation`` with thrusters at the places and along the directions of the file."""
    names = [one.name for one in subject.vehicle.thrusters]
    every = round(PERIOD / equation.step)

    def simulate(commands: FloatArray) -> FloatArray:
        forces = np.zeros((len(commands) * every, 3))
        for unit in units:
            curve = unit.curve
            beyond = repeat_held(commands[:, names.index(curve.name)] - curve.neutral, equation.step)
            if lag.key == COMMAND_LAG:
                beyond = first_order_lag(beyond, lag.time_constant, equation.step)
            thrust = curve(curve.neutral + beyond)
            if lag.key == THRUST_LAG:
                thrust = first_order_lag(thrust, lag.time_constant, equation.step)
            ahead, side = math.cos(unit.direction), math.sin(unit.direction)
            forces += np.outer(thrust, (ahead, side, unit.x * side - unit.y * ahead))
        return equation.simulate(forces, every=every)

    return simulate


def frame_notes(subject: PlanarInput) -> tuple[str, ...]:
    """Assumptions about masses and thrusters."""
    notes = []
    if subject.vehicle.mass is None:
        notes.append("The mass is not known: the smaller inertia of surge and sway is taken as the body's mass.")
    elif subject.vehicle.mass > subject.mass:
        notes.append(
            f"The mass of [vehicle], {subject.vehicle.mass:.4g} kg, exceeds the identified inertia of surge or sway: "
            f"{subject.mass:.4g} kg is taken as the body's mass."
        )
    if subject.vehicle.rigid_body_inertia is None:
        notes.append("The rigid-body inertia is not known: the whole yaw inertia is taken as the body's.")
    if any(one.position is None for one in subject.actuators.thrusters.thrusters):
        notes.append(
            "Thrusters without a position in rovid.toml stand where their line of thrust is closest to the origin."
        )
    notes.append("Heave, roll and pitch are not identified: their inertia is a stand-in, their drag missing.")
    return tuple(notes)
