"""A first-order lag of the command ahead of a thrust curve, as uuv_simulator and Stonefish have it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.export.curves import ThrusterCurve
from rovid.export.export_input import ExportInput

THRUST_LAG = "thruster_lag"
COMMAND_LAG = "thruster_lag:command"


def thruster_lag(subject: ExportInput) -> tuple[float, str]:
    """Time constant in s and key of the lag that the thrusters hold; 0 and nothing where there is none."""
    for key, values in subject.effects.items():
        if key in {THRUST_LAG, COMMAND_LAG}:
            return values["time_constant"], key
    return 0.0, ""


def thruster_inputs(tables: list[ThrusterCurve], form: str) -> list[ThrusterCurve]:
    """The thrusters' curves from input to thrust, with an input of zero at rest, where the lag begins.

    A lag of thrust comes behind the curve, where the simulators have none: there the input is the thrust itself.
    """
    if form != THRUST_LAG:
        return [replace(curve, command=curve.command - curve.neutral, neutral=0.0) for curve in tables]
    inputs = []
    for curve in tables:
        low, high = min(float(curve.thrust.min()), 0.0), max(float(curve.thrust.max()), 0.0)
        ends = np.array([low, high])
        inputs.append(replace(curve, command=ends, thrust=ends, neutral=0.0))
    return inputs


def input_notes(form: str) -> tuple[str, ...]:
    """What the input of a thruster is."""
    if form == THRUST_LAG:
        return ("The thrusters' input is the steady thrust in N, by the curves in the file: thrust lags, not command.",)
    return ("The thrusters' input is the command less its neutral value.",)
