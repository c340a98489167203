"""Tankers of the MMG model: do 10 deg zigzags predict the overshoots of 20 deg zigzags and the 35 deg turning circle?

Run ``python -m benchmarks.planar_manoeuvres --seed 1 --count 3``. tools/planar draws tankers near KVLCC2. rovid learns
on six zigzags of 10 deg, from heading, yaw rate and both speeds, and simulates the other manoeuvres freely under the
logged propeller and rudder. An overshoot counts from the rudder's reversal to the next extreme of the heading.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.catalogue import effect_named
from rovid.planar.dataset import PlanarData, planar_data
from rovid.planar.fit import fit_planar
from rovid.planar.free_runs import simulate_planar
from rovid.readers.campaign import read_campaign
from rovid.trial.config import load_planar_config
from tools.planar import Campaign, draw, simulated, write_campaign
from tools.planar.campaign import Run

SENSORS = ("compass", "gyro", "dvl", "mocap")
LEARN = ("ship zigzag 10",) * 6
PREDICT = ("ship zigzag 20", "ship zigzag 20", "ship turn 35", "ship turn 35")
# The hull's lift and the damping that grows with the speed, which the derivatives of a ship are.
EFFECTS = ("sway_yaw_damping:lift", "speed_dependent_damping:planar")


def read(folder: Path) -> PlanarData:
    config = load_planar_config(folder / "rovid.toml")
    return planar_data(read_campaign([folder], config), config.vehicle)


def overshoots(time: FloatArray, heading: FloatArray, reversals: FloatArray) -> list[float]:
    """Change of the heading (deg) from each reversal of the rudder to the extreme before the next one."""
    found = []
    for begin, end in pairwise(reversals):
        inside = heading[(time >= begin) & (time <= end)]
        away = np.degrees(inside - np.interp(begin, time, heading))
        found.append(float(max(away.max(), -away.min()) if abs(away[-1]) < 1e-9 else _first_extreme(away)))
    return found


def _first_extreme(away: FloatArray) -> float:
    """Size of the swing against the direction in which the heading ends."""
    return float(away.max() if away[-1] < 0.0 else -away.min())


def circle(heading: FloatArray, north: FloatArray, east: FloatArray) -> tuple[float, float]:
    """Advance and tactical diameter (m) of a turn from the start, with the first heading straight ahead."""
    turned = np.abs(heading - heading[0])
    along = (north - north[0]) * np.cos(heading[0]) + (east - east[0]) * np.sin(heading[0])
    across = -(north - north[0]) * np.sin(heading[0]) + (east - east[0]) * np.cos(heading[0])
    return float(along[np.argmax(turned > 0.5 * np.pi)]), float(abs(across[np.argmax(turned > np.pi)]))


def reversals_of(run: Run) -> FloatArray:
    """Instants (s of the log) at which the rudder's order changes its sign, after the first."""
    rudder = run.commands[:, 1]
    turned = np.flatnonzero((np.diff(np.sign(np.diff(rudder))) != 0.0) & (np.abs(rudder[1:-1]) > 0.0)) + 1
    moves = np.diff(rudder)
    starts = [k for k in turned if moves[k] * rudder[k] < 0.0]
    at: FloatArray = run.sent[starts] - run.before
    return at


def judged(seed: int, index: int, effects: tuple[str, ...]) -> dict[str, object]:
    """Errors of one tanker: overshoots in deg, advance and diameter in per cent."""
    learn = draw(seed, index, "none", "tanker", kinds=LEARN, sensors=SENSORS[:3])
    # What a disturbance does to these runs cannot be predicted.
    other = simulated(draw(seed, index, "none", "tanker", kinds=PREDICT, sensors=SENSORS), still=True)
    with tempfile.TemporaryDirectory() as room:
        for name, campaign in (("learn", learn), ("predict", other)):
            write_campaign(Path(room) / name, campaign)
        fit = fit_planar(read(Path(room) / "learn"), [effect_named(name) for name in effects])
        data = read(Path(room) / "predict")
    return {
        "seed": seed, "index": index, "length": other.vehicle.length, "effects": list(effects),
        **_errors(other, [(run.time, simulate_planar(fit.model, run)) for run in data.runs]),
        "undetermined": [one.text for one in fit.undetermined], "free_run_r2": dict(fit.free_run_r2),
    }  # fmt: skip


def _errors(campaign: Campaign, motions: list[tuple[FloatArray, object]]) -> dict[str, list[float]]:
    errors: dict[str, list[float]] = {"overshoot_deg": [], "advance_percent": [], "diameter_percent": []}
    for run, (time, motion) in zip(campaign.runs, motions, strict=True):
        heading = np.asarray(motion.heading)  # type: ignore[attr-defined]  # a PlanarMotion
        if run.kind.startswith("ship zigzag"):
            reversals = reversals_of(run)
            true = overshoots(run.stamps[0] - campaign.sensors[0].latency, run.truth[0][:, 2], reversals)
            errors["overshoot_deg"] += [a - b for a, b in zip(overshoots(time, heading, reversals), true, strict=True)]
        else:
            track = run.truth[SENSORS.index("mocap")]
            true_circle = circle(track[:, 2], track[:, 0], track[:, 1])
            found = circle(heading, np.asarray(motion.north), np.asarray(motion.east))  # type: ignore[attr-defined]
            for name, a, b in zip(("advance_percent", "diameter_percent"), found, true_circle, strict=True):
                errors[name].append(100.0 * (a / b - 1.0))
    return errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--count", type=int, default=3)
    parser.add_argument("--effects", nargs="*", default=list(EFFECTS))
    options = parser.parse_args()
    pooled: dict[str, list[float]] = {}
    for index in range(options.start, options.start + options.count):
        result = judged(options.seed, index, tuple(options.effects))
        print(json.dumps(result), flush=True)
        for name, limit in (("overshoot_deg", 2.0), ("advance_percent", 7.0), ("diameter_percent", 7.0)):
            values = result[name]
            assert isinstance(values, list)
            pooled.setdefault(f"{name} within {limit:.0f}", []).extend(abs(value) <= limit for value in values)
            pooled.setdefault(name, []).extend(abs(value) for value in values)
    for name, values in pooled.items():
        print(f"{name}: {statistics.mean(values):.2f} of {len(values)}")


if __name__ == "__main__":
    main()
