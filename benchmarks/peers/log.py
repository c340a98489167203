"""The log as every peer takes it, where it starts to search, and how it says what it found."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NAMES = ("inertia", "quadratic_drag", "linear_drag")
# kg m^2, N m s^2/rad^2, N m s/rad: of the right size, as whoever fits a vehicle of two tonnes would guess.
START = (3000.0, 2000.0, 200.0)
LOW, HIGH = (100.0, 0.0, 0.0), (1e5, 1e5, 1e4)


def read() -> tuple[Floats, Floats, Floats]:
    """Time in s, torque in N m held from each instant to the next, and heading in rad that does not wrap."""
    time, torque, heading = np.loadtxt(sys.argv[1], delimiter=",", skiprows=1, unpack=True)
    return time, torque, heading


def write(path: str, time: Floats, torque: Floats, heading: Floats) -> None:
    rows = np.column_stack((time, torque, heading))
    np.savetxt(path, rows, delimiter=",", header="time_s,torque_Nm,heading_rad", comments="", fmt="%.9g")


def say(values: Sequence[float] | Floats) -> None:
    """Print what was found, in the order of `NAMES`."""
    print(json.dumps(dict(zip(NAMES, map(float, values), strict=True))))
