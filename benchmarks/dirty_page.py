"""Table and page of the benchmark with dirty logs."""

from __future__ import annotations

import math
import statistics
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.dirty_scores import score

Record = dict[str, Any]
_HEAD = (
    "fault", "folders", "named", "false cause", "fit right", "fit refused", "fit wrong", "other faults", "no go",
    "crash", "check s", "fit s", "diagnose s",
)  # fmt: skip


def line_of(record: Record, result: Record) -> str:
    """One folder in a line of the terminal."""
    truth = record["truth"]
    worst = "refused" if result["worst"] is None else f"{result['worst']:.1f} errors"
    marks = [
        "named" if result["named"] else "named, wrong log" if result["named_somewhere"] else "-",
        worst,
        *(["WRONG CAUSE " + ",".join(result["false_causes"])] if result["false_causes"] else []),
        *(["CRASH " + ",".join(result["crash"])] if result["crash"] else []),
        *(["no go " + ",".join(result["grave"])] if result["no_go"] else []),
        *(["also " + ",".join(result["false_faults"])] if result["false_faults"] else []),
    ]
    total = sum(result["seconds"].values())
    return f"{record['kind']:<17} {record['number']:3d} {truth['format']:<8} {total:5.0f} s  {'; '.join(marks)}"


def _row(kind: str, records: Sequence[Record]) -> list[str]:
    results = [score(record) for record in records]
    count = len(results)
    right = sum(r["worst"] is not None and not r["wrong"] for r in results)
    median = {c: statistics.median(r["seconds"][c] for r in results) for c in ("check", "fit", "diagnose")}
    return [
        kind,
        str(count),
        "" if kind == "none" else str(sum(r["named"] for r in results)),
        str(sum(bool(r["false_causes"]) for r in results)),
        str(right),
        str(sum(r["worst"] is None for r in results)),
        str(sum(bool(r["wrong"]) for r in results)),
        str(sum(bool(r["false_faults"]) for r in results)),
        str(sum(r["no_go"] for r in results)),
        str(sum(bool(r["crash"]) for r in results)),
        *(f"{median[c]:.1f}" for c in ("check", "fit", "diagnose")),
    ]


def table(records: Sequence[Record]) -> str:
    """Table of the scores, one row a fault."""
    kinds: dict[str, list[Record]] = defaultdict(list)
    for record in records:
        kinds[record["kind"]].append(record)
    rows = [_row(kind, group) for kind, group in kinds.items()]
    damaged = [record for record in records if record["kind"] != "none"]
    rows += [_row("all faults", damaged)] if damaged else []
    widths = [max(len(row[k]) for row in (list(_HEAD), *rows)) for k in range(len(_HEAD))]

    def line(cells: Sequence[str]) -> str:
        padded = [
            cell.ljust(w) if k == 0 else cell.rjust(w) for k, (cell, w) in enumerate(zip(cells, widths, strict=True))
        ]
        return f"| {' | '.join(padded)} |"

    rule = [("-" * w) if k == 0 else "-" * (w - 1) + ":" for k, w in enumerate(widths)]
    return "\n".join([line(_HEAD), line(rule), *(line(row) for row in rows)])


def _failures(records: Sequence[Record]) -> list[str]:
    """A line for each folder on which rovid is wrong."""
    lines = []
    for record in records:
        result, truth = score(record), record["truth"]
        words = []
        if record["kind"] != "none" and not result["named"]:
            words.append("named with a wrong log" if result["named_somewhere"] else "not named")
        if result["false_causes"]:
            words.append(f"establishes {', '.join(result['false_causes'])}")
        if result["wrong"]:
            words.append(f"{', '.join(result['wrong'])} wrong, up to {result['worst']:.1f} standard errors")
        if result["crash"]:
            words.append(f"no answer of {', '.join(result['crash'])}")
        if record["kind"] == "none" and (result["false_faults"] or result["no_go"]):
            words.append(f"undamaged, but check reports {', '.join([*result['false_faults'], *result['grave']])}")
        if words:
            size = "" if truth["size"] is None else f", {truth['size']:.3g} {truth['unit']}"
            note = f", {truth['note']}" if truth["note"] else ""
            name = f"{record['kind']} {record['number']}"
            lines.append(f"* `{name}` ({truth['format']}{size}{note}): {'; '.join(words)}.")
    return lines


def _rate(count: int, total: int) -> str:
    """``count`` of ``total`` with the 95 % interval of Wilson (1927)."""
    z, share = 1.96, count / total
    middle = (share + z**2 / (2 * total)) / (1 + z**2 / total)
    half = z / (1 + z**2 / total) * math.sqrt(share * (1 - share) / total + z**2 / (4 * total**2))
    return f"{count} of {total} ({100 * (middle - half):.0f} to {100 * (middle + half):.0f} %)"


def _rates(records: Sequence[Record]) -> str:
    results = [(record["kind"], score(record)) for record in records]
    damaged = [result for kind, result in results if kind != "none"]
    every = [result for _, result in results]
    either = [result["either"] for result in every]
    return (
        f"* Fault named: {_rate(sum(r['named'] for r in damaged), len(damaged))}.\n"
        f"* No false cause: {_rate(sum(not r['false_causes'] for r in every), len(every))}.\n"
        f"* An effect or the fault, with the words that the logs do not distinguish them: {sum(map(bool, either))}.\n"
        f"* Parameters right or refused: {_rate(sum(not r['wrong'] for r in every), len(every))}.\n\n"
        "In brackets: 95 % intervals (Wilson 1927)."
    )


def write_page(records: Sequence[Record], path: Path) -> None:
    """Write the page with the table and every failure."""
    seeds = ", ".join(str(seed) for seed in sorted({record["seed"] for record in records}))
    false = Counter(name for record in records for name in score(record)["false_causes"])
    most = ", ".join(f"`{name}` ({count})" for name, count in false.most_common()) or "none"
    failures = _failures(records)
    text = f"""# Dirty logs: the detection of log faults

{len(records)} folders, seed {seeds}. `python -m benchmarks.dirty` draws folders of logs with one fault of the log each,
and folders without a fault. The vehicles have inertias of 0.4 to 10⁵ kg m² and time constants of 0.2 to 20 s. The
formats are CSV (one table, or two files for each run), MCAP (JSON, ROS 2), ROS 2 bags, DataFlash and ULog. Place and
size of the fault are random. The simulator and the writers share no code with rovid. rovid reads only the files.
The faults imitate reports of real loggers, and were not derived from the detectors.

{table(records)}

{_rates(records)}

*Named*: `check` or `diagnose` names the fault. If only some logs have the fault, every named log is one of them.
*False cause*: `diagnose` establishes an effect that does not act, and does not name the fault as indistinguishable from
it. *Fit right*: inertia and both drags of `fit` are within four standard errors of the truth. *Fit refused*: `fit`
gives no parameter with a standard error. *Other faults*: faults are reported that the folder does not have. *Crash*: a
traceback, or no answer within the time limit. Times are medians of processor time, and may lack the program's start.

False causes: {most}.

## Limits

* The time of each reading is exact before the damage. Real loggers also have a varying latency.
* `several_releases` has tests in yaw, between which a hand turns the vehicle. Free decays in roll and pitch are absent.
* Two payloads in groups of two or three logs are not always named: so few logs hardly show their scatter.
* In one file with late motion, rovid cannot distinguish a clock offset from a delay of the thrusters. It names both.
* Tlog, ROS 1 bags, Parquet and NMEA are absent.

## Failures

{chr(10).join(failures) if failures else "None."}
"""
    path.write_text(text, encoding="utf-8")
