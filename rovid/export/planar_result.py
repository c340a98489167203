"""Result of an exporter of the coupled model, and the forces of a simulator's thrusters."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.export.body_equation import BodyEquation
from rovid.export.interface import PERIOD
from rovid.export.planar_input import PlanarInput, ThrusterUnit
from rovid.export.resimulation import first_order_lag, repeat_held
from rovid.export.thruster_curves import COMMAND_LAG, NO_LAG, THRUST_LAG, ThrusterLag


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
