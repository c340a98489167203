"""What an answer may name, the format of a campaign, and of an answer. numpy and pandas suffice to read them."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NONE, OTHER = "none", "none of these"
CAUSES = {
    "thruster_deadband": "the dead zone of the thrusters is wider than the curve's",
    "thrust_asymmetry": "reverse thrust differs from the curve by a factor",
    "thruster_imbalance": "one thruster differs from its curve by a factor",
    "thrust_curve_shape": "thrust grows with the command by another power than the curve",
    "supply_sag": "the supply, and thrust with it, falls under load, in time, or with a logged voltage",
    "thrust_scale_by_trial": "all thrust differs by a factor between the runs",
    "thruster_lag": "thrust follows its command with a first-order lag, or a longer one than described",
    "command_delay": "commands act late by a dead time",
    "slew_limit": "the rate of change of the command is limited",
    "command_hysteresis": "backlash of the command",
    "advance_speed_loss": "thrust falls with the speed of the water through the propeller, more than described",
    "bias_torque": "a constant torque",
    "drag_curvature": "drag grows by another power of the rate than the square",
    "drag_asymmetry": "drag differs between the two directions",
    "coulomb_resistance": "a constant resistance against the motion",
    "oscillatory_drag": "drag differs after a reversal of the motion",
    "added_mass_memory": "added mass with memory",
    "entrained_swirl": "the turning vehicle sets the water in motion",
    "tether_torsion": "a torque proportional to the turned angle",
    "heading_dependent_torque": "a torque that depends on the heading",
    "heading_deviation": "the compass errs by an angle that depends on the heading",
    "wave_torque": "an oscillating torque at the frequency of waves, beyond the sea described",
    "tank_seiche": "the water of the tank oscillates",
    "speed_dependent_damping": "damping of the turn that grows with the speed ahead",
    "sideslip_moment": "a moment that grows with the sway velocity",
}
LABELS = (*CAUSES, NONE, OTHER)
PARAMETERS = ("inertia", "quadratic_drag", "linear_drag")
LEVELS = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the quantiles that are asked for; each stands for a fifth
NORMAL = np.array([-1.2815515655, -0.5244005127, 0.0, 0.5244005127, 1.2815515655])  # standard normal quantiles
Answer = dict[str, Any]


@dataclass(frozen=True)
class Run:
    """A log: time (n,) in s, heading (n,) in rad, unwrapped, NaN where there is no reading; further columns."""

    name: str
    time: Floats
    heading: Floats
    torques: Floats  #: (n, thrusters) in N m, by arm and curve.
    table: pd.DataFrame


@dataclass(frozen=True)
class Campaign:
    """A folder: vehicle.json and a CSV for each run."""

    folder: Path
    description: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def is_coupled(self) -> bool:
        """Whether the description has the thrusters' shares ahead and to starboard."""
        return all("surge" in one for one in self.description["thrusters"])

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        return tuple(self._run(path) for path in sorted(self.folder.glob("run_*.csv")))

    @property
    def cut(self) -> float:
        """s of the last run, after which its heading is held out."""
        return float(self.description["held_out"]["after_s"])

    @property
    def asked(self) -> Floats:
        """Instants in s of the last run at which the turn since the cut is asked for."""
        return np.array(self.description["held_out"]["times_s"])

    def _run(self, path: Path) -> Run:
        table = pd.read_csv(path)
        torques = [
            one["yaw_arm_m"] * np.interp(table[one["name"]], *np.array(one["curve"]).T)
            for one in self.description["thrusters"]
        ]
        heading = np.radians(table["heading_deg"].to_numpy(dtype=float))
        known = np.isfinite(heading)
        heading[known] = np.unwrap(heading[known])
        return Run(path.stem, table["time_s"].to_numpy(dtype=float), heading, np.column_stack(torques), table)


def read_campaign(folder: Path) -> Campaign:
    """The campaign in a folder."""
    return Campaign(folder, json.loads((folder / "vehicle.json").read_text(encoding="utf-8")))


def spread(odds: dict[str, float], floor: float = 0.05) -> dict[str, float]:
    """Probabilities of all labels: in proportion to the ``odds``, and a share ``floor`` of it equal for all."""
    total = sum(odds.values())
    return {label: (1.0 - floor) * odds.get(label, 0.0) / total + floor / len(LABELS) for label in LABELS}


def quantiles(value: float, error: float) -> list[float]:
    """Quantiles of a normal distribution; of a parameter that is not negative."""
    return [max(float(one), 0.0) for one in value + error * NORMAL]


def forecast(campaign: Campaign, simulated: list[Floats]) -> list[list[float]]:
    """Quantiles in deg of the turn since the cut at the instants asked for, from a free simulation of each run (n,).

    Errors of the simulated turn over equally long spans of the known data give the spread. Beyond the longest span that
    the data hold, it grows with the square root of time.
    """
    last, model = campaign.runs[-1], simulated[-1]
    result = []
    for ahead in campaign.asked - campaign.cut:
        at = np.interp([campaign.cut, campaign.cut + ahead], last.time, model)
        errors, factor, span = np.zeros(0), 1.0, float(ahead)
        while errors.size < 8 and span > 0.02 * ahead:
            parts = []
            for run, own in zip(campaign.runs, simulated, strict=True):
                known = np.isfinite(run.heading)
                time, error = run.time[known], (run.heading - own)[known]
                starts = np.arange(time[0], time[-1] - span, max(0.2 * span, 1e-9))
                parts.append(np.interp(starts + span, time, error) - np.interp(starts, time, error))
            errors, factor, span = np.concatenate(parts), float(np.sqrt(ahead / span)), 0.7 * span
        size = factor * float(np.sqrt(np.mean(errors**2))) if errors.size else 1.0
        result.append([float(np.degrees(at[1] - at[0] + size * one)) for one in NORMAL])
    return result
