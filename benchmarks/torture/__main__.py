"""Command line of the torture benchmark: run the requested inputs that are not done yet, and print the results."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.torture.commands import Input, Place
from benchmarks.torture.pool import Batch, Tried, tried
from benchmarks.torture.samples import FORMATS, samples
from benchmarks.torture.state import State, summary

_BATCH = 500


def main() -> int:
    arguments = _arguments()
    if arguments.only:
        return _only(arguments.only, arguments.seed)
    wanted = ("seed", "inputs", "cuts", "formats")
    state = State(arguments.state, {name: getattr(arguments, name) for name in wanted})
    batches = planned(arguments.formats, arguments.inputs, arguments.cuts, arguments.seed)
    left = [batch for batch in batches if str(batch) not in state.records]
    begin = time.perf_counter()
    for one in tried(left, seed=arguments.seed, jobs=arguments.jobs):
        state.add(str(one.batch), **_counted(one))
    return summary(state, time.perf_counter() - begin)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.torture", description=sys.modules[__package__].__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--inputs", type=int, default=10_000, help="mutations, of all formats and commands together")
    parser.add_argument("--cuts", type=int, default=1, metavar="STEP", help="cut at every STEP-th byte; 0 for none")
    parser.add_argument("--formats", nargs="+", choices=list(FORMATS), default=list(FORMATS), metavar="FORMAT")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--state", type=Path, help="what is done goes here, and is not done again")
    parser.add_argument("--only", metavar="FORMAT:COMMAND:NUMBER", help="this input alone, with all that is printed")
    return parser.parse_args()


def planned(formats: Sequence[str], inputs: int, cuts: int, seed: int) -> list[Batch]:
    """All batches, alternating between formats: an interrupted run is then a fair sample."""
    cells = [(name, command) for name in formats for command in FORMATS[name].commands]
    each = -(-inputs // len(cells)) if inputs else 0
    found: list[tuple[float, Batch]] = []
    for name, command in cells:
        changed = FORMATS[name].changed
        kinds = [(False, range(each if changed != "nothing" else len(samples(name))))]
        if cuts and changed == "content":
            kinds.append((True, range(seed % cuts, len(samples(name)[0].data), cuts)))
        for cut, numbers in kinds:
            for start in range(0, len(numbers), _BATCH):
                batch = Batch(format=name, command=command, cut=cut, numbers=numbers[start : start + _BATCH])
                found.append((start / len(numbers), batch))
    return [batch for _, batch in sorted(found, key=lambda one: one[0])]


def _counted(one: Tried) -> dict[str, Any]:
    """What is kept of a batch."""
    codes = Counter(result.code for result in one.results)
    return {
        "inputs": len(one.results),
        "read": codes[0],
        "refused": codes[2],
        "seconds": one.seconds,
        "slowest": max(result.seconds for result in one.results),
        "failures": [
            (str(each), failure)
            for each, result in zip(one.batch.inputs(), one.results, strict=True)
            for failure in result.failures
        ],
    }


def _only(name: str, seed: int) -> int:
    """One input, in a folder that stays."""
    format_name, command, number = name.split(":")
    place = Place(Path(tempfile.mkdtemp(prefix="torture-")))
    failures = place.shown(Input(format=format_name, command=command, number=number), seed).failures
    for failure in failures:
        print(f"{failure.kind}: {failure.where}: {failure.text}")
    return int(bool(failures))


if __name__ == "__main__":
    raise SystemExit(main())
