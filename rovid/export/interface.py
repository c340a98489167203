"""Input and result of an exporter, for yaw alone and for surge, sway and yaw together; simulation with thrusters."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import neutral_commands
from rovid.export.body_equation import BodyEquation, Scheme, yaw_equation
from rovid.export.thruster_curves import (
    COMMAND_LAG,
    NO_LAG,
    THRUST_LAG,
    ThrusterCurve,
    ThrusterLag,
    ThrusterUnit,
    is_of_curve,
    thruster_curves,
)
from rovid.model.bound_effects import BoundEffect
from rovid.model.model import Model
from rovid.store.parameter_file import Entry, Parameters
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions
from rovid.trial.numba_loops import first_order_sum
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Thruster, Vehicle

# s, for which each command of the verification is held; a multiple of the integration step of every simulator.
PERIOD = 0.1
# Names of the velocities in messages and JSON, and their units.
VELOCITIES = {"surge_velocity": "m/s", "sway_velocity": "m/s", "yaw_rate": "rad/s"}
# kg, stand-in for an unknown mass. Simulators refuse a mass of zero; yaw motion does not depend on it.
_STAND_IN_MASS = 1.0
# rad/s, largest yaw rate without logs.
_ASSUMED_RATE = 0.3
# Sections of the verification: length in settling times, and share of the largest command at a share x of the length.
_SECTIONS: tuple[tuple[float, Callable[[float], float]], ...] = (
    (1.0, lambda _: 0.0),
    (5.0, lambda _: 1.0),
    (4.0, lambda _: 0.0),
    (5.0, lambda _: -1.0),
    (4.0, lambda _: 0.0),
    (4.0, lambda _: 0.6),
    (10.0, lambda x: math.sin(4.0 * math.pi * x)),
    (10.0, lambda x: 0.7 * math.sin(8.0 * math.pi * x)),
    (5.0, lambda _: 0.0),
)
# s, range of the settling time, for enough samples and a finite length.
_SETTLING = (1.0, 15.0)

# The simulator's equation of motion, integrated as the simulator does: (n, k) commands, each held for `PERIOD` -> (n,
# v) velocities over ground at the beginning of each, from rest, in rovid's signs: yaw rate, or surge, sway and yaw.
Simulate = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Subject(ABC):
    """Model and vehicle to export, along one axis or coupled."""

    velocities: ClassVar[Mapping[str, str]]  #: Velocities that are compared, with their units.
    title: ClassVar[str]  #: Words on a model in FLU axes.

    vehicle: Vehicle
    entries: Mapping[str, Entry]  #: Parameters with units and standard errors.
    commands: FloatArray  #: (k, 2) smallest and largest command of each actuator in the logs.
    notes: tuple[str, ...] = ()  #: Assumptions about the vehicle and its trials.
    guess: Assumptions = field(default_factory=Assumptions)  #: Arms and curves that were not measured.

    @property
    @abstractmethod
    def bound_effects(self) -> tuple[BoundEffect, ...]:
        """Effects of the model with their parameters."""

    @property
    @abstractmethod
    def thrusters(self) -> tuple[Vehicle, FloatArray]:
        """The vehicle with its thrusters alone, and (k, 2) the smallest and largest command of each."""

    @property
    @abstractmethod
    def units(self) -> list[ThrusterUnit]:
        """Thrusters of the vehicle in a simulator, with their places."""

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """Parameters of each effect, by the key of the effect."""
        return {one.effect.key: dict(one.values) for one in self.bound_effects}

    def value(self, key: str, name: str) -> float:
        """Parameter ``name`` of the effect ``key``; 0 if the model is without the effect."""
        return self.effects.get(key, {}).get(name, 0.0)

    @cached_property
    def curves(self) -> list[ThrusterCurve]:
        """Thrust curve of each thruster, memoryless effects included."""
        return thruster_curves(*self.thrusters, [one for one in self.bound_effects if is_of_curve(one.effect)])

    @property
    def curve_keys(self) -> frozenset[str]:
        """Keys of the effects that a thrust curve represents."""
        return frozenset(one.effect.key for one in self.bound_effects if is_of_curve(one.effect))

    def rigid_within(self, whole: float) -> float:
        """Inertia of the rigid body in yaw in kg m^2; the ``whole`` one if not known or larger than that."""
        return min(self.vehicle.rigid_body_inertia or whole, whole)

    @property
    def lag(self) -> ThrusterLag:
        """First-order lag in front of or behind the thrust curves."""
        lags = (ThrusterLag.of(key, values) for key, values in self.effects.items())
        return next(filter(None, lags), NO_LAG)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportInput(Subject):
    """Yaw model and vehicle to export."""

    velocities = MappingProxyType({"yaw_rate": "rad/s"})
    title = "yaw identified by rovid; z up, a yaw rate is minus the heading's"
    least_ranges = (0.0,)

    model: Model
    largest_rate: float  #: rad/s, largest yaw rate in the logs.
    reference: Mapping[str, float]  #: Median of each further channel of the logs.
    #: ``heading_noise``, ``torque_in_use``: of the logs, in rad and N m; None without logs.
    heading_noise: float | None = None
    torque_in_use: float | None = None

    @property
    def bound_effects(self) -> tuple[BoundEffect, ...]:
        """Effects of the model with their parameters."""
        return self.model.bound_effects

    @property
    def thrusters(self) -> tuple[Vehicle, FloatArray]:
        """The vehicle, and the commands in the logs."""
        return self.vehicle, self.commands

    @cached_property
    def units(self) -> list[ThrusterUnit]:
        """Thrusters on the x axis at plus and minus their yaw arm in turn, as their places are not known."""
        found = []
        for curve in self.curves:
            direction = curve.side * math.pi / 2.0
            found.append(ThrusterUnit(curve, curve.side * curve.arm, 0.0, direction, (0.0, 0.0, curve.arm)))
        return found

    @property
    def envelope(self) -> tuple[float, float, float]:
        """Largest speeds in m/s and rad/s."""
        return 0.0, 0.0, self.largest_rate

    @property
    def mass(self) -> float:
        """Mass in kg, or a stand-in."""
        return self.vehicle.mass or _STAND_IN_MASS

    @property
    def rigid_inertia(self) -> float:
        """Inertia of the rigid body in kg m^2; the whole inertia if not known or larger than that."""
        return self.rigid_within(self.model.inertia)

    @property
    def added_inertia(self) -> float:
        """Added inertia in kg m^2."""
        return self.model.inertia - self.rigid_inertia

    @property
    def frame_notes(self) -> list[str]:
        """Assumptions about inertia and thrusters in FLU axes."""
        rigid, inertia = self.vehicle.rigid_body_inertia, self.model.inertia
        notes = ["Axes are FLU, z up: a yaw rate there is minus rovid's, which grows with the heading."]
        if rigid is None:
            words = "The rigid-body inertia is not known: the whole inertia is taken as the body's, added inertia 0."
            notes.append(words)
        elif rigid > inertia:
            note = f"The rigid-body inertia of [vehicle], {rigid:.4g} kg m^2, exceeds the identified {inertia:.4g} kg "
            notes.append(f"{note}m^2: the whole is taken as the body's, added inertia 0.")
        if self.vehicle.mass is None:
            notes.append("The mass is not known: 1 kg stands in its place.")
        text = "Roll, pitch and the other axes are not identified: their inertia is a stand-in, their drag missing."
        notes.append(text)
        if any(thruster.curve is not None for thruster in self.vehicle.thrusters):
            notes.append(
                "Thrusters stand on the x axis at plus and minus their yaw arm in turn, pushing across: the yaw torque "
                "is right, the places are not known."
            )
        return notes

    @property
    def settling_time(self) -> float:
        """Time constant in s of small changes at half the largest yaw rate of the logs."""
        slope = self.model.linear_drag + self.model.quadratic_drag * self.largest_rate
        return self.model.inertia / max(slope, 1e-12)

    def equation(self, step: float, scheme: Scheme = Scheme.RUNGE_KUTTA, **terms: Any) -> BodyEquation:
        """The base model's equation of yaw, in steps of ``step`` s; ``terms`` as in `yaw_equation`."""
        own = {"inertia": self.model.inertia, "linear": self.model.linear_drag, "quadratic": self.model.quadratic_drag}
        return yaw_equation(**(own | terms), step=step, scheme=scheme)

    @property
    def drag_terms(self) -> dict[str, Any]:
        """Cubic drag and drag asymmetry, as terms of `equation`."""
        ratio = self.value("drag_asymmetry", "ratio")
        return {"cubic": self.value("drag_curvature", "cubic"), "ratio": ratio or 1.0}

    def with_effects(self, keys: frozenset[str]) -> Model:
        """The model with only these effects."""
        return self.model.with_effects(lambda effect: effect.key in keys)

    def motion(self, model: Any, commands: FloatArray) -> FloatArray:
        """(n, 1) yaw rate in rad/s of a `Model` from rest under (n, k) ``commands`` for `PERIOD` each."""
        time = PERIOD * np.arange(len(commands), dtype=np.float64)
        trial = Trial.from_commands(time, commands, reference=self.reference)
        rate: FloatArray = model.simulate(trial, model.torque_input(self.vehicle, trial))[0]
        return rate[:, None]

    def commands_at(self, shares: FloatArray) -> FloatArray:
        """(n, k) commands of (n,) ``shares`` of the largest ones in the logs, positive where the heading turns up."""
        vehicle, columns = self.vehicle, []
        for thruster, neutral, ends in zip(vehicle.thrusters, neutral_commands(vehicle), self.commands, strict=True):
            low, high = ends[np.argsort(thruster.torque(ends), kind="stable")]
            columns.append(np.interp(shares, [-1.0, 0.0, 1.0], [low, neutral, high]))
        return np.column_stack(columns)

    def verification_shares(self) -> tuple[FloatArray, float, int]:
        """(n,) shares for `PERIOD` each: holds, coast-downs and sines; least factor, and bisections for the factor."""
        settling = min(max(self.settling_time, _SETTLING[0]), _SETTLING[1])
        samples: list[float] = []
        for length, shape in _SECTIONS:
            count = round(length * settling / PERIOD)
            samples += [shape(k / count) for k in range(count)]
        return np.array(samples), 0.0, 30


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportResult:
    """Content of an exported file, and the simulator's equation with the numbers in it."""

    content: str | bytes
    simulate: Simulate | None  #: None where the file holds no model of the vehicle.
    equation: BodyEquation  #: The simulator's equation for the verdict on stability.
    kept_effects: frozenset[str]  #: Keys of the effects that the file represents.
    keeps_angles: bool = False  #: Whether the file represents rudders and azimuth angles.
    #: (parameter, reason) of the parts of the base model that the file cannot represent.
    base_losses: Sequence[tuple[str, str]] = ()
    notes: Sequence[str] = ()  #: Assumptions, and facts that the user has to know.


def export_input(stored: Parameters, study: Study | None) -> ExportInput:
    """Input from a parameter file and its logs, if they exist. Raises ConfigError without inertia or drag."""
    model = stored.model()
    vehicle = Vehicle(name=stored.vehicle or "vehicle", thrusters=()) if study is None else study.vehicle
    # An effect whose channel is not logged is evaluated at 1.
    reference = {channel: 1.0 for effect in model.effects for channel in effect.needs}
    if study is not None and study.runs is not None and study.campaign is not None:
        study.require_effects(model.effects)
        trials = study.campaign.trials
        commands = np.concatenate([trial.commands for trial in trials])
        return ExportInput(
            model=model,
            vehicle=vehicle,
            entries=stored.entries,
            largest_rate=max(float(np.nanmax(np.abs(run.rates.rate))) for run in study.runs.items),
            commands=np.column_stack([np.nanmin(commands, axis=0), np.nanmax(commands, axis=0)]),
            reference=reference | dict(trials[0].reference),
            heading_noise=study.position_noise(),
            torque_in_use=study.median_torque(),
        )
    largest = float(model.drag(np.array(_ASSUMED_RATE)))
    thruster = Thruster(name="yaw_torque", arm=1.0, curve=None, max_logged_torque=largest)
    note = f"There are no logs of the yaw rate and the thrusters. A largest yaw rate of {_ASSUMED_RATE:g} rad/s is "
    note += "assumed, and the yaw torque itself is the command."
    return ExportInput(
        model=model,
        vehicle=replace(vehicle, thrusters=(thruster,)),
        entries=stored.entries,
        largest_rate=_ASSUMED_RATE,
        commands=np.array([[-largest, largest]]),
        reference=reference,
        notes=(note,),
    )


def repeat_held(values: FloatArray, step: float) -> FloatArray:
    """(n*m, ...) of (n, ...) values that are held for `PERIOD`: one for each of its m steps."""
    return np.repeat(values, round(PERIOD / step), axis=0)


def first_order_lag(values: FloatArray, time_constant: float, step: float) -> FloatArray:
    """First-order lag of (m,) ``values`` from zero, updated exactly before each step."""
    if time_constant <= 0.0:
        return values
    fade = math.exp(-step / time_constant)
    return first_order_sum((1.0 - fade) * values, fade)


def unit_forces(
    subject: Subject,
    commands: FloatArray,
    step: float,
    units: Sequence[ThrusterUnit] | None = None,
    lag: ThrusterLag = NO_LAG,
    delay: float = 0.0,
) -> FloatArray:
    """(m, 3) forces along surge and sway, and torque in yaw, in each ``step`` in s under (n, k) ``commands``.

    ``units``: Thrusters of the file; by default those of the ``subject``. ``delay`` in s acts between curve and lag.
    """
    names = [one.name for one in subject.vehicle.thrusters]
    forces = np.zeros((len(commands) * round(PERIOD / step), 3))
    for unit in subject.units if units is None else units:
        curve = unit.curve
        beyond = repeat_held(commands[:, names.index(curve.name)] - curve.neutral, step)
        if lag.key == COMMAND_LAG:
            beyond = first_order_lag(beyond, lag.time_constant, step)
        thrust = curve(curve.neutral + beyond)
        if delay:
            thrust = np.concatenate([np.full(round(delay / step), thrust[0]), thrust])[: len(thrust)]
        if lag.key == THRUST_LAG:
            thrust = first_order_lag(thrust, lag.time_constant, step)
        forces += np.outer(thrust, unit.lever)
    return forces


def simulation(
    subject: Subject,
    equation: BodyEquation,
    units: Sequence[ThrusterUnit] | None = None,
    lag: ThrusterLag = NO_LAG,
    delay: float = 0.0,
) -> Simulate:
    """Simulation of ``equation`` with thrusters as in `unit_forces`."""

    def simulate(commands: FloatArray) -> FloatArray:
        forces = unit_forces(subject, commands, equation.step, units, lag, delay)
        return equation.simulate(forces, every=round(PERIOD / equation.step))[:, -len(subject.velocities) :]

    return simulate
