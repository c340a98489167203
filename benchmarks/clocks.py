"""How well `rovid init` tells how far the clocks of one trial's files are apart, and how often it says a wrong thing.

Run ``python -m benchmarks.clocks --seed S --count 100``. Each folder is made up by `tools.folders`, one file a sensor,
clocks up to 2 s apart and drifting by up to 200 ppm; a third of the thrusters' loggers hold a heading too, a third a
yaw rate. Where the two saw the same, what is said is held against the truth. So it is where the vehicle's answers alone
tell, though the made-up thrusters lag; what counts there is whether a clock that is called ahead is ahead.
"""

from __future__ import annotations

import argparse
import json
import secrets
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tools.folders import Clocks, Folder, write_folder

# A clock that is said to be ahead and is not, by more than this in s, is a wrong thing to say.
_WRONG = 0.1


@dataclass(frozen=True)
class Told:
    """Of one log: s by which its clock was said to be off, less the truth; its standard error; what was said."""

    off: float
    error: float
    truth: float
    by: str
    certain: bool
    drift: float
    drift_error: float
    drift_off: float


def told(folder: Path, truth: Folder) -> list[Told] | str:
    """What `rovid init` says of each log of the thrusters; the message where it refuses."""
    command = [sys.executable, "-m", "rovid", "init", str(folder), "--json", "--force"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        return done.stderr.strip()
    document = json.loads(done.stdout)
    found = {clock["name"]: clock for clock in document["clocks"]}
    rows = []
    for log, ahead in truth.ahead.items():
        clock = found.get(log) or found.get("thrusters")
        if clock is None:
            continue
        middle = truth.middle[log] if clock["middle"] else 0.0
        rows.append(
            Told(
                off=clock["offset"] + ahead + truth.drift * middle,
                error=clock["error"],
                truth=-ahead,
                by=clock["by"],
                certain=clock["certain"],
                drift=clock["drift"],
                drift_error=clock["drift_error"],
                drift_off=clock["drift"] + 1e6 * truth.drift,
            )
        )
    return rows


def _summed(name: str, rows: list[Told]) -> Iterator[str]:
    if not rows:
        return
    off, error = (np.array([getattr(row, key) for row in rows]) for key in ("off", "error"))
    within = [100.0 * float(np.mean(np.abs(off) <= times * error)) for times in (1.0, 2.0, 3.0)]
    yield (
        f"{name}: {len(rows)} logs; off by {np.median(off):+.3f} s in the middle, "
        f"{np.percentile(np.abs(off), 90):.3f} s at nine in ten; stated {np.median(error):.3f} s; "
        f"within 1, 2, 3 of it {within[0]:.0f}, {within[1]:.0f}, {within[2]:.0f} %"
    )


def main() -> None:
    """Print a line a folder, and how often it was right."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6))
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--only", type=int, action="append", help="index of a folder; may be given again")
    parser.add_argument("--keep", type=Path, help="folder for the logs; it is left there")
    options = parser.parse_args()
    print(f"seed {options.seed}")
    alike: list[Told] = []
    answered: list[Told] = []
    silent = 0
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(2) as pool:

        def tried(index: int) -> tuple[Folder, list[Told] | str]:
            folder = (options.keep or Path(name)) / f"{index:02d}"
            clocks = Clocks.drawn(np.random.default_rng([options.seed, index, 1]))
            truth = write_folder(folder, seed=options.seed, index=index, clocks=clocks)
            return truth, told(folder, truth)

        indices = options.only or range(options.count)
        for index, (truth, rows) in zip(indices, pool.map(tried, indices), strict=True):
            if isinstance(rows, str) or not rows:
                silent += 1
                print(f"{index:02d}  nothing  {truth.about}  {rows or ''}", flush=True)
                continue
            for row in rows:
                (alike if row.by else answered).append(row)
                mark = "clock" if row.certain else "open"
                drift = (
                    f" drift {row.drift:.0f} ± {row.drift_error:.0f} ppm, off {row.drift_off:.0f}" if row.drift else ""
                )
                print(
                    f"{index:02d}  {mark:5}  {row.truth:+.3f} s, off {row.off:+.4f} ± {row.error:.4f}{drift}  "
                    f"{row.by or 'answers'}  {truth.about}",
                    flush=True,
                )
    for line in (*_summed("alike", alike), *_summed("by answers", answered)):
        print(line)
    wrong = [
        row for row in answered if row.certain and (row.truth > -_WRONG / 2 or row.off < -_WRONG - 2.0 * row.error)
    ]
    ahead = [row for row in answered if row.truth < -_WRONG]
    said = sum(row.certain for row in ahead)
    print(f"by answers: of {len(ahead)} logs with a clock ahead {said} were said to be; said wrongly: {len(wrong)}")
    drifts = [row for row in alike if row.drift]
    within = sum(abs(row.drift_off) <= 2.0 * row.drift_error for row in drifts)
    print(f"drift: shown in {len(drifts)} of {len(alike)} logs that are alike, {within} within 2 standard errors")
    print(f"nothing was said of {silent} folders")


if __name__ == "__main__":
    main()
