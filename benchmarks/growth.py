"""Do time and memory of a fit and of a diagnosis grow in proportion to the data? One synthetic day, 4 and 16 of them.

Each day has its own seed; the kernels are compiled before. ``--hide CASE`` hides an effect (a name of `tools.cases`).
"""

from __future__ import annotations

import argparse
import json
import secrets
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.usage import Usage, measured
from tools.cases import all_cases, truth_of
from tools.trial_day import write_trial_day
from tools.truth import VEHICLES

# How many days each command is given.
COMMANDS, DAYS = ("fit", "diagnose"), (1, 4, 16)


def write_days(folder: Path, days: int, seed: int, case: str | None) -> list[str]:
    """Days side by side in ``folder``, under one rovid.toml; the names of their folders."""
    hidden = () if case is None else (next(each for each in all_cases(VEHICLES[0]) if each.name == case),)
    names = [f"day_{day}" for day in range(days)]
    for day, name in enumerate(names):
        write_trial_day(folder / name, seed=seed + day, formats="csv", truth=truth_of(VEHICLES[0], hidden))
        for shared in ("rovid.toml", "thrust_curve.csv"):
            (folder / name / shared).replace(folder / shared)
    return names


def taken(folder: Path, command: str, names: Sequence[str]) -> Usage:
    """What rovid's ``command`` takes of the days with these names."""
    return measured([sys.executable, "-m", "rovid", command, *names, "-p", f"{command}.toml", "--json"], folder)


def said(command: str, out: str) -> str:
    """The verdict of a diagnosis and what it found; of a fit, how many headings there were."""
    document = json.loads(out)
    if command == "fit":
        return f"{document['samples']} headings"
    return f"{document['verdict']} {', '.join(finding['effect'] for finding in document['findings'])}".strip()


def row(days: int, usage: Usage, first: Usage) -> str:
    """Time and memory for ``days`` days, absolute and relative to one day."""
    rows = [(usage.seconds, first.seconds, "s"), (usage.processor, first.processor, "s of processor")]
    rows.append((usage.megabytes, first.megabytes, "MB"))
    return f"{days:3} x: " + ", ".join(f"{one:7.1f} {unit} ({one / base:5.2f} x)" for one, base, unit in rows)


def more(days: int, usage: Usage, first: Usage) -> str:
    """What each day beyond the first takes."""
    beyond = days - 1
    seconds, processor = (usage.seconds - first.seconds) / beyond, (usage.processor - first.processor) / beyond
    megabytes = (usage.megabytes - first.megabytes) / beyond
    return f"each 1 x more: {seconds:.1f} s, {processor:.1f} s of processor, {megabytes:.0f} MB"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6))
    parser.add_argument("--hide", metavar="CASE")
    parser.add_argument("--only", choices=COMMANDS, action="append", help="this command alone")
    arguments = parser.parse_args()
    commands = arguments.only or COMMANDS
    print(f"seed {arguments.seed}, hidden: {arguments.hide or 'nothing'}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        names = write_days(folder, max(DAYS), arguments.seed, arguments.hide)
        for command in commands:
            taken(folder, command, names[:1])  # compiles, where that was not done before
            first = usage = taken(folder, command, names[:1])
            print(f"rovid {command}\n{row(1, first, first)}; {said(command, first.out)}", flush=True)
            for days in DAYS[1:]:
                usage = taken(folder, command, names[:days])
                print(f"{row(days, usage, first)}; {said(command, usage.out)}", flush=True)
            print(more(max(DAYS), usage, first))


if __name__ == "__main__":
    main()
