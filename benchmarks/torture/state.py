"""State of a run in a file, from which an interrupted run continues, and the summary of all results."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.torture.commands import Failure

Record = Mapping[str, Any]


class State:
    """Mapping from the name of an input to its result.

    Parameters
    ----------
    path
        None: nothing is kept.
    settings
        Of this run; those of another do not go on here.
    """

    def __init__(self, path: Path | None, settings: Mapping[str, Any]) -> None:
        self.path, self.seed = path, settings["seed"]
        self.records: dict[str, Record] = {}
        if path is None:
            return
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            self._append(settings)
            return
        # The last line may have been cut with the run.
        lines = [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]
        path.write_text("".join(lines))
        first, *others = map(json.loads, lines)
        if first != settings:
            raise SystemExit(f"{path} is of another run, {first}: give its options, or another file.")
        for record in others:
            self.records[record["name"]] = record
            self._say(record)

    def add(self, name: str, *, failures: Sequence[tuple[str, Failure]], seconds: float, **counts: float) -> None:
        """Keep what came of ``name``: (input, failure) pairs, and counts as ``inputs`` or ``refused``."""
        listed = [{"input": one, **asdict(failure)} for one, failure in failures]
        record = {"name": name, "seconds": seconds, **counts, "failures": listed}
        self.records[name] = record
        self._append(record)
        self._say(record)

    def _append(self, record: Record) -> None:
        if self.path is not None:
            with self.path.open("a") as stream:
                stream.write(json.dumps(record) + "\n")

    def _say(self, record: Record) -> None:
        for one in record["failures"]:
            again = f"--seed {self.seed} --only {shlex.quote(one['input'])}"
            print(f"{one['kind']}: {one['where']}: {again}: {one['text']!r}", flush=True)


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

    def add(self, record: Record) -> None:
        self.inputs += record["inputs"]
        self.read += record.get("read", 0)
        self.refused += record.get("refused", 0)
        self.failed += len({one["input"] for one in record["failures"]})
        self.seconds += record["seconds"]
        self.slowest = max(self.slowest, record.get("slowest", record["seconds"]))
        self.kinds.update(one["kind"] for one in record["failures"])


def summary(state: State, seconds: float) -> int:
    """Print what came of what, and of how many kinds the failures are; 1 where there are any, else 0."""
    tallies: dict[str, Tally] = {}
    distinct: dict[tuple[str, str], list[str]] = {}
    for record in state.records.values():
        tallies.setdefault(record["name"].rpartition(":")[0], Tally()).add(record)
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
