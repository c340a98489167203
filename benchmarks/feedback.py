"""How often `rovid check` sees feedback where there is none, and where there is: simulated runs of many kinds.

Plain vehicles (`tools.steering`), each run by itself, and hard water (`tools.hard`), each campaign as a whole. Run
``python -m benchmarks.feedback --runs 100 --campaigns 400 --seed 1000``.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rovid.preflight.feedback_detection import SIGNIFICANCE_LEVEL, detect_feedback
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tools.hard import Campaign, draw
from tools.hard.thrust import bench
from tools.steering import CLOSED, OPEN, Steered, steered

# How runs in hard water are driven without a look at how the vehicle moves.
_BLIND = {"holds", "sines", "prbs", "steps"}
_LOGGED = Vehicle(name="plain", thrusters=(Thruster(name="torque", arm=1.0, curve=None),))


def trial_of(run: Steered) -> Trial:
    """As a log of heading and torque would be read."""
    return Trial(
        name=run.kind, path=Path(run.kind), time=run.time, position=run.heading, commands=run.torque[:, np.newaxis]
    )


def seen(run: Steered) -> bool:
    """Whether there is feedback in a run, by the check."""
    return any(one.chance < SIGNIFICANCE_LEVEL for one in detect_feedback([trial_of(run)], _LOGGED))


def seen_in(campaign: Campaign) -> Iterator[tuple[str, bool]]:
    """How each run of a campaign in hard water is driven, and whether there is feedback in it, by the check."""
    listed = [index for index, one in enumerate(campaign.vehicle.thrusters) if one.listed]
    points = np.linspace(-1.0, 1.0, 201)
    thrusters = []
    for index in listed:
        one = campaign.vehicle.thrusters[index]
        thrust = np.array([bench(float(point), one.row(0.0)) for point in points])
        thrusters.append(Thruster(name=one.name, arm=one.arm, curve=ThrustCurve(command=points, thrust=thrust)))
    trials = []
    for number, run in enumerate(campaign.runs):
        log, name = run.log, f"run_{number}"
        heading = np.round(log.heading / (finest := np.radians(campaign.instruments.heading_step))) * finest
        time = log.time - log.time[0]
        trials.append(Trial(name=name, path=Path(name), time=time, position=heading, commands=log.commands[:, listed]))
    found = detect_feedback(trials, Vehicle(name=campaign.vehicle.name, thrusters=tuple(thrusters)))
    named = {one.name for one in found if one.chance < SIGNIFICANCE_LEVEL}
    return ((run.drive.kind, trial.name in named) for run, trial in zip(campaign.runs, trials, strict=True))


def main() -> None:
    """Print a line for each kind of run."""
    parser = argparse.ArgumentParser(description="False alarms and misses of the test for feedback.")
    parser.add_argument("--runs", type=int, default=100, help="of each kind of a plain vehicle")
    parser.add_argument("--campaigns", type=int, default=400, help="in hard water")
    parser.add_argument("--seed", type=int, default=1000)
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.runs)
    counts: Counter[tuple[bool, str]] = Counter()
    found: Counter[tuple[bool, str]] = Counter()
    for kind in (*OPEN, *CLOSED):
        counts[kind in CLOSED, kind] = len(seeds)
        found[kind in CLOSED, kind] = sum(seen(steered(kind, seed)) for seed in seeds)
    for seed in range(arguments.seed, arguments.seed + arguments.campaigns):
        for kind, named in seen_in(draw(seed)):
            key = (kind not in _BLIND, f"hard water, {kind}")
            counts[key] += 1
            found[key] += named
    for closed, title in ((False, "open loop, seen by mistake"), (True, "closed loop, seen")):
        chosen = [key for key in counts if key[0] is closed]
        print(f"{title}: {sum(found[key] for key in chosen)} of {sum(counts[key] for key in chosen)}")
        for key in chosen:
            print(f"  {key[1]:32} {found[key]:5} of {counts[key]:5}, {100.0 * found[key] / counts[key]:5.1f} %")


if __name__ == "__main__":
    main()
