"""Does the time of a diagnosis grow in proportion to the data? The sample day once, and ten such days together.

Each day has its own seed; the kernels are compiled before. ``--hide CASE`` hides an effect (a name of `tools.cases`).
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rovid.campaign.config import find_config, load_config
from rovid.readers import read_campaign
from tools.cases import all_cases, truth_of
from tools.trial_day import write_trial_day
from tools.truth import VEHICLES

DAYS = (1, 10)


def write_days(folder: Path, days: int, seed: int, case: str | None) -> int:
    """Campaigns of several days side by side in one folder; the number of their samples."""
    hidden = () if case is None else (next(each for each in all_cases(VEHICLES[0]) if each.name == case),)
    for day in range(days):
        write_trial_day(folder / f"day_{day}", seed=seed + day, formats="csv", truth=truth_of(VEHICLES[0], hidden))
        for name in ("rovid.toml", "thrust_curve.csv"):
            source = folder / f"day_{day}" / name
            if source.exists():
                source.replace(folder / name)
    return read_campaign([folder], load_config(find_config([folder]))).samples


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6))
    parser.add_argument("--hide", metavar="CASE")
    arguments = parser.parse_args()
    taken: dict[int, tuple[int, float]] = {}
    for days in (0, *DAYS):  # the first run compiles, where that was not done before
        with tempfile.TemporaryDirectory() as name:
            samples = write_days(Path(name) / "logs", max(days, 1), arguments.seed, arguments.hide)
            command = [sys.executable, "-m", "rovid", "diagnose", "logs", "--json"]
            begun = time.perf_counter()
            done = subprocess.run(command, cwd=name, env=os.environ, capture_output=True, text=True, check=True)
            taken[days] = samples, time.perf_counter() - begun
            found = json.loads(done.stdout)
            if days:
                names = [finding["effect"] for finding in found["findings"]]
                print(f"{samples} samples: {taken[days][1]:.1f} s, {found['verdict']} {', '.join(names)}", flush=True)
    (fewer, short), (more, long) = (taken[days] for days in DAYS)
    print(f"{more / fewer:.1f} times the data, {long / short:.1f} times the time (seed {arguments.seed})")


if __name__ == "__main__":
    main()
