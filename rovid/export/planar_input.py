"""Input of the exporters of the coupled model, its commands for verification, and rovid's own motion."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import neutral_commands
from rovid.export.body_equation import BodyEquation, Scheme
from rovid.export.interface import PERIOD, VELOCITIES, Subject
from rovid.export.thruster_curves import ThrusterUnit
from rovid.model.bound_effects import BoundEffect
from rovid.planar.dataset import PlanarData
from rovid.planar.free_runs import PlanarMotion, simulate_planar
from rovid.planar.model import AXIS_SPEEDS, PlanarActuators, PlanarCommands, PlanarModel
from rovid.store.parameter_file import Parameters
from rovid.store.planar_study import PlanarStudy, planar_model
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Thruster, Vehicle

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
# Least range of a velocity in percentages, as a share of the envelope of the logs.
_LEAST_RANGE = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarInput(Subject):
    """Coupled model and vehicle to export."""

    velocities = VELOCITIES
    title = "surge, sway and yaw identified by rovid; FLU axes, z up"

    model: PlanarModel
    envelope: FloatArray  #: (3,) largest speeds in m/s and rad/s in the logs.

    @property
    def least_ranges(self) -> FloatArray:
        """(3,) least range of each velocity for percentages."""
        return _LEAST_RANGE * self.envelope

    @cached_property
    def actuators(self) -> PlanarActuators:
        """The actuators."""
        return PlanarActuators(self.vehicle)

    @property
    def bound_effects(self) -> tuple[BoundEffect, ...]:
        """Effects of the model with their parameters."""
        return self.model.effects

    def with_effects(self, keys: frozenset[str]) -> PlanarModel:
        """The model with only these effects."""
        return replace(self.model, effects=tuple(one for one in self.model.effects if one.effect.key in keys))

    @cached_property
    def thrusters(self) -> tuple[Vehicle, FloatArray]:
        """The vehicle with its thrusters alone, and (k, 2) the smallest and largest command of each."""
        return self.actuators.thrusters, self.commands[self.actuators.thruster_columns]

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
                    lever = (0.0, sign, arm)
                    found.append(ThrusterUnit(half, sign * arm, 0.0, sign * math.pi / 2.0, lever))
                continue
            # The point of the line of thrust that is closest to the origin, where the place is not known.
            x, y = thruster.position or (arm * side / size**2, -arm * ahead / size**2)
            scaled = replace(curve, thrust=size * curve.thrust)
            lever = (ahead / size, side / size, (x * side - y * ahead) / size)
            found.append(ThrusterUnit(scaled, x, y, math.atan2(side, ahead), lever))
        return found

    @property
    def mass(self) -> float:
        """Mass in kg of the rigid body; the smaller inertia of surge and sway if not known or larger than that."""
        largest = float(min(self.model.base[:2]))
        return min(self.vehicle.mass or largest, largest)

    @property
    def rigid_inertia(self) -> float:
        """Inertia of the rigid body in yaw in kg m^2; all of it if not known or larger than that."""
        return self.rigid_within(float(self.model.base[2]))

    @property
    def frame_notes(self) -> list[str]:
        """Assumptions about masses and thrusters in FLU axes."""
        notes, mass = ["Axes are FLU, z up: sway and yaw rate there are minus rovid's."], self.vehicle.mass
        if mass is None:
            notes.append("The mass is not known: the smaller inertia of surge and sway is taken as the body's mass.")
        elif mass > self.mass:
            text = f"The mass of [vehicle], {mass:.4g} kg, exceeds the identified inertia of surge or sway: "
            notes.append(f"{text}{self.mass:.4g} kg is taken as the body's mass.")
        if self.vehicle.rigid_body_inertia is None:
            notes.append("The rigid-body inertia is not known: the whole yaw inertia is taken as the body's.")
        if any(one.position is None for one in self.actuators.thrusters.thrusters):
            notes.append(
                "Thrusters without a position in rovid.toml stand where their line of thrust is closest to the origin."
            )
        return [*notes, "Heave, roll and pitch are not identified: their inertia is a stand-in, their drag missing."]

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
        return np.array([self.value("bias_torque:planar", name) for name in ("surge", "sway", "yaw")])

    def equation(self, step: float, scheme: Scheme, **terms: Any) -> BodyEquation:
        """The equation with each axis' own damping, and further fields of `BodyEquation` in ``terms``."""
        linear, absolute = self.own_damping
        own = {"mass": self.model.mass_matrix, "linear": linear, "absolute": absolute}
        return BodyEquation(**(own | terms), step=step, scheme=scheme)

    def own_equation(self, step: float) -> BodyEquation:
        """Rovid's equation with a Runge-Kutta step of ``step`` s."""
        linear, absolute, _ = self.damping
        terms = {"current": np.array(self.model.current), "coefficients": self.model.coefficients}
        return self.equation(step, Scheme.RUNGE_KUTTA, linear=linear, absolute=absolute, **terms)

    def motion(self, model: Any, commands: FloatArray) -> FloatArray:
        """(n, 3) velocities over ground of a `PlanarModel`, from rest under (n, k) ``commands`` for `PERIOD` each."""
        time = PERIOD * np.arange(len(commands), dtype=np.float64)
        forces = self.actuators.forces(
            PlanarCommands(self.actuators, Trial.from_commands(time, commands)), model.actuator_effects
        )
        scale, ends = np.maximum(self.envelope, 1e-3), np.array([0, len(time)])
        motion = PlanarMotion.simulated(model, ends, time, forces.inputs, np.zeros((1, 6)), scale)
        return motion.sensors(AXIS_SPEEDS)

    def verification_shares(self) -> tuple[FloatArray, float, int]:
        """(n, 3) shares for `PERIOD` each, along each axis, combined, and at rest; least factor, and bisections."""
        slopes = self.model.base[4:7] + self.model.base[7:10] * np.maximum(self.envelope, 1e-3)
        slowest = float(np.max(self.model.base[:3] / np.maximum(slopes, 1e-9)))
        count = round(_LENGTH * min(max(slowest, _SLOWEST[0]), _SLOWEST[1]) / PERIOD)
        return np.repeat(np.array(_SECTIONS), count, axis=0), 0.05, 8

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
    """Input from a parameter file and its logs, if they exist. Raises ConfigError if a parameter is missing."""
    notes = []
    if stored.assumed:
        names = ", ".join(stored.assumed)
        text = f"The logs do not determine {names}: stand-ins are written, which they neither support nor refute."
        notes.append(text)
    if study is None:
        model = planar_model(stored).of_vehicle
        envelope = np.array(_ASSUMED)
        largest = model.base[4:7] * envelope + model.base[7:10] * envelope**2
        thrusters = tuple(
            Thruster(name=f"{name}_force", arm=shares[2], curve=None, surge_share=shares[0], sway_share=shares[1])
            for name, shares in (("surge", (1.0, 0.0, 0.0)), ("sway", (0.0, 1.0, 0.0)), ("yaw", (0.0, 0.0, 1.0)))
        )
        words = "There are no logs of the vehicle and its thrusters. Forces along the three axes are the commands, and "
        words += f"largest speeds of {_ASSUMED[0]:g} m/s, {_ASSUMED[1]:g} m/s and {_ASSUMED[2]:g} rad/s are assumed."
        notes.append(words)
        return PlanarInput(
            model=model,
            vehicle=Vehicle(name=stored.vehicle or "vehicle", thrusters=thrusters, planar=True),
            entries=stored.entries,
            envelope=envelope,
            commands=np.column_stack((-largest, largest)),
            notes=tuple(notes),
        )
    model, data = study.model(stored).of_vehicle, study.data
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
