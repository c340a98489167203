"""Thrust curves for `rovid init`: those in the folder, that of the type of vehicle, or a straight line."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rovid.core.errors import RovidError
from rovid.core.input_files import list_files
from rovid.preflight.log_reading import is_thrust_curve
from rovid.preflight.thruster_guess import ThrusterCommand
from rovid.trial.tables import read_curve
from rovid.trial.vehicle import ThrustCurve
from rovid.trial.vehicle_presets import VehiclePreset

GUESSED_CURVE = "thrust_guess.csv"
# N, thrust at the end of a guessed curve. Yaw data do not determine a common scale of all thrusts.
FULL_THRUST = 100.0
# us, lowest and highest pulse width of a guessed curve.
_PULSES = (1100.0, 1900.0)
# Ratio of the end of a guessed curve to the largest command in the logs.
_HEADROOM = 1.1


def thrust_curves(
    folder: Path, commands: Sequence[ThrusterCommand], profile: VehiclePreset | None, problems: list[str]
) -> tuple[list[str], ThrustCurve | None, bool]:
    """File names of the thrust curves, the curve if the file is new, and whether it is a guess.

    Curves in the folder that cover the commands come first, then that of the type of vehicle, then a straight line.
    """
    if not commands:
        return [], None, False
    lowest = min(command.lowest for command in commands)
    highest = max(command.highest for command in commands)
    if found := measured_curves(folder, lowest, highest, problems):
        return found, None, False
    neutral = commands[0].neutral
    if profile is not None and profile.curve is not None and neutral:
        published = read_curve(profile.curve)
        if _covers(published, lowest, highest):
            return [profile.curve.name], published, False
    if neutral:
        ends = np.array([min(_PULSES[0], lowest), neutral, max(_PULSES[1], highest)])
    else:
        largest = max(abs(lowest), abs(highest))
        # Commands as shares of one or in percent end at 1 or 100.
        end = next((full for full in (1.0, 100.0) if 0.3 * full < largest <= full), _HEADROOM * largest)
        if largest <= 100.0 and any(command.in_percent for command in commands):
            end = 100.0
        ends = np.array([-end, 0.0, end])
    above = ends - neutral
    line = ThrustCurve(command=ends, thrust=FULL_THRUST * above / np.max(np.abs(above)))
    return [GUESSED_CURVE], line, True


def measured_curves(folder: Path, lowest: float, highest: float, problems: list[str]) -> list[str]:
    """Names of the thrust curves in the folder that cover the commands."""
    found = []
    for path in list_files(folder, lambda _: None).files:
        if path.parent != folder or path.name == GUESSED_CURVE or not is_thrust_curve(path):
            continue
        try:
            curve = read_curve(path)
        except RovidError as error:
            problems.append(str(error))
            continue
        if _covers(curve, lowest, highest):
            found.append(path.name)
    return found


def _covers(curve: ThrustCurve, lowest: float, highest: float) -> bool:
    margin = 0.01 * curve.span
    return bool(curve.command[0] <= lowest + margin and highest - margin <= curve.command[-1])
