"""Where each number stands in the arrays that the compiled code takes, and how code is compiled."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_Signature = ParamSpec("_Signature")
_Result = TypeVar("_Result")


# Numba looks at the file of a function alone to tell whether what it kept is still good, not at those it calls into.
# What is kept therefore stands in a folder by the text of all files here.
_FOLDER = Path(__file__).parent
_TEXT = b"".join(path.read_bytes() for path in sorted(_FOLDER.glob("*.py")))
_KEPT = _FOLDER / "__pycache__" / hashlib.sha256(_TEXT).hexdigest()[:12]


def compiled(function: Callable[_Signature, _Result]) -> Callable[_Signature, _Result]:
    """The function as machine code, kept between runs."""
    settings: Any = numba.config  # which has more than its types say
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(_KEPT)
    machine = numba.njit(cache=True, error_model="numpy")(function)
    settings.CACHE_DIR = before
    return cast("Callable[_Signature, _Result]", machine)


# Places in the array of a hidden cause. Zero, or the value in `no_cause`, means no effect.
(
    BIAS, CUBIC, POWER, POWER_RATE, ASYMMETRY, ASYMMETRY_RATE, COULOMB, STICTION, STRIBECK_RATE, COULOMB_RATE,
    OSCILLATORY, OSCILLATORY_ANGLE, MEMORY, MEMORY_TIME, MEMORY_QUADRATIC, SWIRL, SWIRL_BRAKE, TETHER, TETHER_HARDENING,
    TETHER_REST, HEADING_1, HEADING_1_PHASE, HEADING_2, HEADING_2_PHASE, SEICHE, SEICHE_FREQUENCY, SEICHE_DAMPING,
    SPEED_LINEAR, SPEED_QUADRATIC, SIDESLIP, MUNK, SWELL,
    DEADBAND, DEADBAND_SOFT, REVERSE, REVERSE_THRUST, UNEQUAL, UNEQUAL_GAIN, SHAPE, SAG, SAG_TIME, DRIFT, SCALE,
    PLAY, SCHMITT_ON, SCHMITT_OFF, SLEW_UP, SLEW_DOWN, ADVANCE, ADVANCE_2, DEVIATION_1, DEVIATION_1_PHASE, DEVIATION_2,
    DEVIATION_2_PHASE, N_CAUSE,
) = range(55)  # fmt: skip

# Their names, for the record of a truth.
CAUSE_NAMES = tuple(name for name, place in list(globals().items()) if name.isupper() and isinstance(place, int))[
    :N_CAUSE
]

# The hull: masses with the water's share, drag, and what couples yaw to surge and sway.
(
    M11, M22, M23, M33, X_U, X_UU, Y_V, Y_VV, DL, DQ, CROSS_FLOW, N_UV, N_UR, LENGTH, N_HULL,
) = range(15)  # fmt: skip

# One thruster: direction, place, bench curve, nominal loss to advance speed.
(
    POD, COS, SIN, PLACE_X, PLACE_Y, ARM, FORWARD, BACKWARD, ZONE_FORWARD, ZONE_BACKWARD, EXPONENT, LOSS, N_THRUSTER,
) = range(13)  # fmt: skip

# What surrounds the vehicle, and its series at half steps.
(
    WAVE_DIRECTION, WAVE_SURGE, WAVE_SWAY, WAVE_YAW, WAVE_DRIFT, WAVE_DRIFT_YAW, WIND_DIRECTION, WIND_SURGE, WIND_SWAY,
    WIND_YAW, EDDY_YAW, N_WEATHER,
) = range(12)  # fmt: skip
WAVE, WAVE_QUADRATURE, GUST, EDDY, SWELL_MOMENT, N_SERIES = range(6)

# How the demand in yaw comes about.
OPEN_LOOP, AUTOPILOT, ZIGZAG, STICK = range(4)
(GAIN_P, GAIN_I, GAIN_D, DEMAND_LIMIT, ZIGZAG_ANGLE, STICK_DELAY, STICK_LEVELS, N_PILOT) = range(8)

# What a run records at every step.
(R_PSI, R_RATE, R_SURGE, R_SWAY, R_TORQUE, R_TORQUE_PLAIN, R_BENCH, R_WATER_0, R_WATER_1, R_WAVES, N_RECORD) = range(11)


def no_cause() -> Floats:
    """The array of a cause, with nothing in it that acts."""
    cause = np.zeros(N_CAUSE)
    cause[[REVERSE, UNEQUAL_GAIN, SHAPE, SCALE]] = 1.0
    cause[[SLEW_UP, SLEW_DOWN]] = np.inf
    cause[UNEQUAL] = -1.0
    # Denominators of what is off.
    cause[
        [POWER_RATE, ASYMMETRY_RATE, STRIBECK_RATE, COULOMB_RATE, OSCILLATORY_ANGLE, MEMORY_TIME, SWIRL, SAG_TIME]
    ] = 1
    cause[[SEICHE_FREQUENCY, REVERSE_THRUST]] = 1.0
    cause[SWIRL] = 0.0
    return cause
