"""What is asked for, what is done already, and what came of it."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.torture.commands import Input
from benchmarks.torture.pool import Batch, Tried, tried
from benchmarks.torture.samples import FORMATS, samples

_BATCH = 500


@dataclass(kw_only=True)
class Tally:
    """What came of the inputs of one format and command."""

    inputs: int = 0
    read: int = 0
    refused: int = 0
    failed: int = 0
    seconds: float = 0.0
    slowest: float = 0.0
    kinds: Counter[str] = field(default_factory=Counter)

    def add(self, record: Mapping[str, Any]) -> None:
        self.inputs += record["inputs"]
        self.read += record["read"]
        self.refused += record["refused"]
        self.failed += len({one["input"] for one in record["failures"]})
        self.seconds += record["seconds"]
        self.slowest = max(self.slowest, record["slowest"])
        self.kinds.update(one["kind"] for one in record["failures"])


def main() -> int:
    arguments = _arguments()
    if arguments.only:
        return _only(arguments.only, arguments.seed)
    settings = {
        "seed": arguments.seed,
        "inputs": arguments.inputs,
        "cuts": arguments.cuts,
        "formats": arguments.formats,
    }
    batches = planned(arguments.formats, arguments.inputs, arguments.cuts, arguments.seed)
    records = _done_before(arguments.state, settings)
    for record in records.values():
        _say(record, arguments.seed)
    left = [batch for batch in batches if str(batch) not in records]
    begun = time.perf_counter()
    for one in tried(left, seed=arguments.seed, jobs=arguments.jobs):
        record = _record(one)
        records[str(one.batch)] = record
        if arguments.state:
            _append(arguments.state, record)
        _say(record, arguments.seed)
    return _summary(list(records.values()), time.perf_counter() - begun)


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
    """All that is to be done, each format in its turn: what is ended early is a fair sample."""
    cells = [(name, command) for name in formats for command in FORMATS[name].commands]
    each = -(-inputs // len(cells)) if inputs else 0
    found: list[tuple[float, Batch]] = []
    for name, command in cells:
        size = len(samples(name)[0].data)
        kinds = [(False, range(each))]
        if cuts and not FORMATS[name].named:
            kinds.append((True, range(seed % cuts, size, cuts)))
        for cut, numbers in kinds:
            for start in range(0, len(numbers), _BATCH):
                batch = Batch(format=name, command=command, cut=cut, numbers=numbers[start : start + _BATCH])
                found.append((start / len(numbers), batch))
    return [batch for _, batch in sorted(found, key=lambda one: one[0])]


def _record(one: Tried) -> dict[str, Any]:
    """What is kept of a batch."""
    failures = [
        {"input": str(one_input), **asdict(failure)}
        for one_input, result in zip(one.batch.inputs(), one.results, strict=True)
        for failure in result.failures
    ]
    codes = Counter(result.code for result in one.results)
    return {
        "batch": str(one.batch),
        "inputs": len(one.results),
        "read": codes[0],
        "refused": codes[2],
        "seconds": one.seconds,
        "slowest": max(result.seconds for result in one.results),
        "failures": failures,
    }


def _append(path: Path, record: Mapping[str, Any]) -> None:
    with path.open("a") as stream:
        stream.write(json.dumps(record) + "\n")


def _done_before(state: Path | None, settings: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Batch -> its record, of a run that was ended."""
    if state is None:
        return {}
    if not state.exists():
        state.parent.mkdir(parents=True, exist_ok=True)
        _append(state, settings)
        return {}
    lines = state.read_text().splitlines(keepends=True)
    first = json.loads(lines[0])
    if first != settings:
        raise SystemExit(f"{state} is of another run, {first}: give that one's options, or another file.")
    # The last line may have been cut with the run.
    whole = [json.loads(line) for line in lines[1:] if line.endswith("\n")]
    state.write_text("".join(line for line in lines if line.endswith("\n")))
    return {record["batch"]: record for record in whole}


def _say(record: Mapping[str, Any], seed: int) -> None:
    for one in record["failures"]:
        print(f"{one['kind']}: {one['where']}: --seed {seed} --only {one['input']}: {one['text']!r}", flush=True)


def _summary(records: Sequence[Mapping[str, Any]], seconds: float) -> int:
    tallies: dict[str, Tally] = {}
    distinct: dict[tuple[str, str], list[str]] = {}
    for record in records:
        tallies.setdefault(record["batch"].rpartition(":")[0], Tally()).add(record)
        for one in record["failures"]:
            distinct.setdefault((one["kind"], one["where"]), []).append(one["input"])
    for line in (*_table(tallies), "", *_distinct(distinct)):
        print(line)
    inputs, failed = (sum(getattr(one, name) for one in tallies.values()) for name in ("inputs", "failed"))
    print(f"{inputs} inputs in {seconds:.0f} s, {failed} failed in {len(distinct)} ways.")
    return int(failed > 0)


def _table(tallies: Mapping[str, Tally]) -> Iterator[str]:
    form = "{:<26}{:>9}{:>9}{:>9}{:>8}{:>8}{:>9}  {}"
    yield form.format("format:command", "inputs", "read", "refused", "failed", "1/s", "slowest", "failures")
    for name, one in sorted(tallies.items()):
        kinds = ", ".join(f"{count} {kind}" for kind, count in one.kinds.most_common())
        rate = f"{one.inputs / one.seconds:.0f}" if one.seconds else ""
        slowest = f"{one.slowest:.2f} s"
        yield form.format(name, one.inputs, one.read, one.refused, one.failed, rate, slowest, kinds or "none")


def _distinct(found: Mapping[tuple[str, str], Sequence[str]]) -> Iterator[str]:
    for (kind, where), inputs in sorted(found.items(), key=lambda one: (one[0][0], -len(one[1]))):
        yield f"{len(inputs):7} {kind}: {where} (as {', '.join(inputs[:3])})"


def _only(name: str, seed: int) -> int:
    """One input, in a folder that stays, and the command to run there."""
    import tempfile

    from benchmarks.torture.commands import Place, prepare

    format_name, command, number = name.split(":")
    one = Input(format=format_name, command=command, number=number)
    prepare()
    place = Place(Path(tempfile.mkdtemp(prefix="torture-")))
    for failure in place.tried(one, seed).failures:
        print(f"{failure.kind}: {failure.where}: {failure.text}")
    return 1


if __name__ == "__main__":
    raise SystemExit(main())
