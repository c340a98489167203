"""What a campaign lacks for a diagnosis, and what to run."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rovid.diagnose.splitting import MIN_TRIALS, min_part_length, recorded_seconds
from rovid.signals.preprocessing import Run

# A rate below so many times its noise is no motion.
_MOTION = 2.0


def missing_data(runs: Sequence[Run], cutoff: float) -> str:
    """What is missing for a diagnosis, and what to run; ``cutoff`` in Hz is the low pass's."""
    if len(runs) < MIN_TRIALS:
        return _too_few(runs, cutoff)
    axis = runs[0].trial.axis
    if all(run.trial.has_actuators for run in runs) and not any(map(_is_pushed, runs)):
        return (
            f"no thruster ever runs: there is no {axis.force_name} to explain the motion with. Log a run under thrust."
        )
    if not any(map(_moves, runs)):
        moves, move = ("turns", "turn") if axis.angular else ("moves", "move")
        return (
            f"the vehicle never {moves}: its {axis.rate_words} is no larger than the sensor's noise makes it. Check "
            f"that {axis.position_signal} in rovid.toml is the vehicle's, and run sines, steps or a pseudo-random command "
            f"that {move} it."
        )
    return ""


def _too_few(runs: Sequence[Run], cutoff: float) -> str:
    part = min_part_length(runs, cutoff)
    seconds = sum(recorded_seconds(run.trial) for run in runs)
    return (
        f"there are too few trials ({len(runs)}, {seconds:.0f} s in all) to hold any out and test a cause on, and "
        f"they are too short to be cut into {MIN_TRIALS} parts of {part:.0f} s. Record more runs, of other "
        "kinds (a hold the other way, a sine, a coast-down)."
    )


def _is_pushed(run: Run) -> bool:
    """Whether a thruster ever runs."""
    return bool(np.any(run.torque != 0.0))


def _moves(run: Run) -> bool:
    """Whether the rate is more than the sensor's noise."""
    rate = run.rates.rate[np.isfinite(run.rates.rate)]
    # What the noise alone would add up to.
    still = run.rates.rate_noise * math.sqrt(len(rate))
    return bool(np.linalg.norm(rate) > _MOTION * still)
