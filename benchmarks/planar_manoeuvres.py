"""Ships of the MMG model: do 10 deg zigzags predict the overshoots of 20 deg zigzags and the 35 deg turning circle?

Run ``python -m benchmarks.planar_manoeuvres --seed 1 --count 3``. tools/planar draws tankers near KVLCC2, or with
``--family merchant`` finer hulls. The logs are those of free-running model tests: time, position, heading, speeds, yaw
rate, rudder angle and propeller speed. rovid fits four zigzags of 10 deg by its command line; its standard manoeuvres
are compared with those of the ship.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from tools.planar import Campaign, draw, simulated
from tools.planar.campaign import Run

LEARN = ("ship zigzag 10",) * 4
# Each with the rudder to starboard or to port first, as drawn.
PREDICT = (*("ship zigzag 20",) * 4, *("ship turn 35",) * 4)
# Standard deviations at a level of 1: position in lengths, heading and rate in deg and deg/s, speeds in full speeds.
NOISE = (0.001, 0.03, 0.02, 0.002)
COLUMNS = ("time", "x", "y", "psi", "u", "v", "r", "delta", "rpm")
TOML = """[vehicle]
mass = {mass:.5g}
length = {length:.4g}
width = {width:.4g}

[[thrusters]]
name = "propeller"
surge = 1.0
curve = "curve.csv"
command = {{ csv = "rpm" }}

[[rudders]]
name = "rudder"
position = [{place:.5g}, 0.0]
behind = "propeller"
area = {area:.4g}
angle = {{ csv = "delta", unit = "deg" }}

[signals]
time = {{ csv = "time" }}
north = {{ csv = "x" }}
east = {{ csv = "y" }}
heading = {{ csv = "psi", unit = "deg" }}
surge_velocity = {{ csv = "u" }}
sway_velocity = {{ csv = "v" }}
yaw_rate = {{ csv = "r", unit = "deg/s" }}
"""


def states(campaign: Campaign, run: Run, rate: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n,) s, (n, 6) true states and (n, 2) commands at a ``rate`` in Hz."""
    known = run.stamps[0] - campaign.sensors[0].latency
    time = np.arange(math.ceil(known[0] * rate), math.floor(known[-1] * rate)) / rate
    truth = np.column_stack([np.interp(time, known, column) for column in run.truth[0].T])
    sent = run.sent - run.before
    return time, truth, np.column_stack([np.interp(time, sent, column) for column in run.commands.T])


def write(folder: Path, campaign: Campaign, rate: float, level: float) -> None:
    """Logs, propeller curve and rovid.toml in a ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    vehicle = campaign.vehicle
    rudder = vehicle.actuators[1]
    sizes = {"mass": vehicle.mass, "length": vehicle.length, "width": vehicle.width}
    (folder / "rovid.toml").write_text(TOML.format(**sizes, place=rudder.x, area=rudder.area), encoding="utf-8")
    curve = np.column_stack((vehicle.commands[0], vehicle.thrusts[0]))
    np.savetxt(folder / "curve.csv", curve, delimiter=",", header="command,thrust_N", comments="")
    place, heading, turn, speed = NOISE
    noise = np.array([place * vehicle.length] * 2 + [heading] + [speed * vehicle.full[0]] * 2 + [turn])
    for number, run in enumerate(campaign.runs):
        time, truth, commands = states(campaign, run, rate)
        truth[:, [2, 5]] = np.degrees(truth[:, [2, 5]])
        rng = np.random.default_rng([campaign.seed, campaign.index, number, 5])
        rows = np.column_stack((time, truth + level * noise * rng.normal(size=truth.shape), commands[:, ::-1]))
        text = {"delimiter": ",", "header": ",".join(COLUMNS), "comments": "", "fmt": "%.5f"}
        np.savetxt(folder / f"zigzag_{number + 1}.csv", rows, **text)


def overshoots(heading: FloatArray, threshold: float) -> list[float]:
    """First and second overshoot angle in deg of a zigzag of (n,) headings in rad."""
    turned = np.degrees(heading - heading[0])
    rate = np.diff(turned)
    tops = np.flatnonzero((rate[1:] * rate[:-1] <= 0.0) & (rate[:-1] != 0.0)) + 1
    return [abs(float(turned[at])) - threshold for at in tops if abs(turned[at]) > threshold][:2]


def circle(track: FloatArray) -> tuple[float, float]:
    """Advance and tactical diameter in m of a turn of (n, 6) states from its start."""
    north, east, heading = track[:, 0] - track[0, 0], track[:, 1] - track[0, 1], track[:, 2]
    turned = np.abs(heading - heading[0])
    along = north * np.cos(heading[0]) + east * np.sin(heading[0])
    across = east * np.cos(heading[0]) - north * np.sin(heading[0])
    return float(along[np.argmax(turned > 0.5 * np.pi)]), float(abs(across[np.argmax(turned > np.pi)]))


def from_amidships(run: Run) -> Run:
    """The run with its rudder amidships at first: a drawn turn begins at its angle, and no rudder is that fast."""
    demands = run.demands.copy()
    demands[0, 2] = 0.0
    return replace(run, demands=demands)


def true_measures(seed: int, index: int, family: str) -> dict[str, float]:
    """Measures of a ship in still water by name in ``standard_manoeuvres``; means over the drawn thrusts."""
    campaign = draw(seed, index, "none", family, kinds=PREDICT, sensors=("compass",))
    campaign = simulated(replace(campaign, runs=tuple(map(from_amidships, campaign.runs))), still=True)
    found: dict[str, list[float]] = {}
    for run in campaign.runs:
        _, track, commands = states(campaign, run, 20.0)
        side = float(np.sign(commands[np.argmax(np.abs(commands[:, 1]) > 1.0), 1]))
        if run.kind.startswith("ship zigzag") and side > 0.0:
            for name, value in zip(("first", "second"), overshoots(track[:, 2], 20.0), strict=False):
                found.setdefault(f"zigzag_20.{name}_overshoot", []).append(math.radians(value))
        elif run.kind.startswith("ship turn"):
            way = "starboard" if side > 0.0 else "port"
            for name, value in zip(("advance", "tactical_diameter"), circle(track), strict=True):
                found.setdefault(f"circle_{way}.{name}", []).append(value)
    return {name: statistics.mean(values) for name, values in found.items()}


def answer(folder: Path) -> dict[str, Any]:
    """Document of ``rovid fit --axes planar``."""
    command = [sys.executable, "-m", "rovid", "fit", str(folder), "--axes", "planar", "--json"]
    command += ["-p", str(folder / "parameters.toml")]
    slow = os.environ | {"ROVID_BUDGET": "3600"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=slow)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def judged(
    seed: int, index: int, level: float, rate: float, keep: Path | None, family: str = "tanker"
) -> dict[str, Any]:
    """Predicted and true measures of one ship with their errors: deg of overshoots, % of lengths."""
    learn = draw(seed, index, "none", family, kinds=LEARN, sensors=("compass",))
    true = true_measures(seed, index, family)
    with tempfile.TemporaryDirectory() as room:
        folder = (keep or Path(room)) / f"{family}_{seed}_{index}_{level:g}"
        write(folder, learn, rate, level)
        document = answer(folder)
    rows = {}
    for name, value in true.items():
        one = document["standard_manoeuvres"].get(name)
        if one is None:
            rows[name] = {"true": value, "error": None, "inside": True}
            continue
        scale = math.degrees(1.0) if "overshoot" in name else 100.0 / value
        error, spread = scale * (one["value"] - value), scale * (one["standard_error"] or math.inf)
        rows[name] = {"true": value, "error": error, "standard_error": spread, "inside": abs(error) <= 1.96 * spread}
    kept = {key: document[key] for key in ("criterion", "free_run_r2", "effects")}
    return {"seed": seed, "index": index, "level": level, "measures": rows, **kept}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--family", choices=["tanker", "merchant"], default="tanker")
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--count", type=int, default=3)
    parser.add_argument("--levels", type=float, nargs="*", default=[1.0, 4.0], help="noise of the sensors")
    parser.add_argument("--rate", type=float, default=4.0, help="Hz")
    parser.add_argument("--keep", type=Path, help="folder to leave the logs in")
    options = parser.parse_args()
    pooled: dict[str, list[bool]] = {}
    for index in range(options.start, options.start + options.count):
        for level in options.levels:
            result = judged(options.seed, index, level, options.rate, options.keep, options.family)
            print(json.dumps(result), flush=True)
            for name, one in result["measures"].items():
                limit = 2.0 if "overshoot" in name else 7.0
                within = one["error"] is not None and abs(one["error"]) <= limit
                pooled.setdefault(f"{name} within {limit:.0f}", []).append(within)
                pooled.setdefault(f"{name} inside its interval", []).append(one["inside"])
    for name, values in pooled.items():
        print(f"{name}: {sum(values)} of {len(values)}")


if __name__ == "__main__":
    main()
