"""Measure how often `rovid init` finds heading and thrusters in made-up folders of logs.

Run ``python -m benchmarks.folders``. rovid gets the files only. A folder is *right* if rovid.toml has the time, the
heading with its unit, and every thruster that turns the vehicle with its sign, and no other thruster. A folder is
*open* if rovid names every missing or wrong part in a warning or a refusal, and *wrong* otherwise. Without a heading
no sign can be determined: a message about the missing heading covers the signs.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tools.axis_folders import AxisFolder, write_axis_folder
from tools.folders import Folder, write_folder

Verdict = Literal["right", "open", "wrong"]
# Words by which a message names a part without naming its column.
_SAID = {"heading": ("heading",), "thruster": ("thruster", "command"), "time": ("time", "clock")}


@dataclass(frozen=True)
class Fault:
    """An error of rovid.toml in a ``part`` of `_SAID`, with its ``source`` in the logs."""

    part: str
    source: str
    text: str

    def said(self, messages: Sequence[str]) -> bool:
        """Whether a message names the source, or speaks of that part as a whole."""
        whole = self.part in {"heading", "time"}
        return any(
            (self.source and self.source in message) or (whole and _speaks(message, self.part)) for message in messages
        )


@dataclass(frozen=True, kw_only=True)
class Score:
    """What rovid made of a folder; ``aside`` does not count."""

    verdict: Verdict
    faults: tuple[str, ...]
    aside: tuple[str, ...] = ()


def init(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run `rovid init`."""
    command = [sys.executable, "-m", "rovid", "init", str(folder), "--json", "--force", *options]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def scored(folder: Path, truth: Folder) -> Score:
    """Run `rovid init` on ``folder`` and hold it against ``truth``."""
    done = init(folder)
    if done.returncode:
        told = (
            done.returncode == 2
            and "Traceback" not in done.stderr
            and any(_speaks(done.stderr, part) for part in _SAID)
        )
        return Score(verdict="open" if told else "wrong", faults=(f"exit {done.returncode}: {done.stderr.strip()}",))
    document = json.loads(done.stdout)
    config = tomllib.loads((folder / "rovid.toml").read_text(encoding="utf-8"))
    faults = list(_faults(config, truth))
    messages = [str(message) for message in (*document.get("open", ()), *document.get("warnings", ()))]
    blind = "heading" not in config.get("signals", {}) and Fault("heading", "", "").said(messages)
    silent = [fault for fault in faults if not fault.said(messages) and not (blind and fault.part == "thruster")]
    verdict: Verdict = "wrong" if silent else "open" if faults else "right"
    texts = tuple(f"{fault.text}{' (not said)' if fault in silent else ''}" for fault in faults)
    return Score(verdict=verdict, faults=texts, aside=tuple(_aside(config, truth, folder)))


def scored_along(folder: Path, truth: AxisFolder) -> Score:
    """As `scored`, of a folder along another axis."""
    done = init(folder, "--axis", truth.axis)
    if done.returncode:
        return Score(verdict="open", faults=(f"exit {done.returncode}: {done.stderr.strip()}",))
    document = json.loads(done.stdout)
    config = tomllib.loads((folder / "rovid.toml").read_text(encoding="utf-8"))
    messages = [str(message) for message in (*document["open"], *document["warnings"])]
    faults = []
    found = {_source(entry, "csv"): entry for name, entry in config["signals"].items() if name != "time"}
    entry = found.get(truth.measured, {})
    if entry.get("unit") != truth.unit:
        faults.append(Fault("heading", truth.measured, f"{truth.measured} is in {truth.unit}, taken: {found}"))
    if _source(config["signals"].get("time"), "csv") != truth.time:
        faults.append(Fault("time", truth.time, f"time is {truth.time}"))
    key = {"roll": "roll_arm"}.get(truth.axis, truth.axis)
    blocks = config.get("thrusters", ())
    active = {_source(block["command"], "csv"): (block[key] > 0) - (block[key] < 0) for block in blocks}
    for name in {*active, *truth.thrusters}:
        way, got = truth.thrusters.get(name, 0), active.get(name, 0)
        if way != got * int(entry.get("sign", 1)):
            faults.append(Fault("thruster", name, f"{name} moves it {way:+d}, taken: {got:+d}"))
    silent = [fault for fault in faults if not fault.said(messages)]
    texts = tuple(f"{fault.text}{' (not said)' if fault in silent else ''}" for fault in faults)
    return Score(verdict="wrong" if silent else "open" if faults else "right", faults=texts)


def _speaks(text: str, part: str) -> bool:
    return any(word in text.lower() for word in _SAID[part])


def _source(entry: Any, kind: str) -> str:
    """The column or topic of an entry of rovid.toml; text alone is a CSV column."""
    if isinstance(entry, Mapping):
        return str(entry.get(kind, ""))
    return str(entry) if entry is not None and kind == "csv" else ""


def _faults(config: Mapping[str, Any], truth: Folder) -> Iterator[Fault]:
    signals: Mapping[str, Any] = config.get("signals", {})
    entry = signals.get("heading")
    found = _source(entry, truth.format)
    sign = int(entry.get("sign", 1)) if isinstance(entry, Mapping) else 1
    unit = str(entry.get("unit", "deg")) if isinstance(entry, Mapping) else "deg"
    if found != truth.heading:
        yield Fault(
            "heading", truth.heading or found, f"heading is {truth.heading or 'nowhere'}, taken: {found or '-'}"
        )
    elif found and unit != truth.heading_unit:
        yield Fault("heading", found, f"{found} is in {truth.heading_unit}, taken: {unit}")
    entry = signals.get("time")
    if truth.time and _source(entry, "csv") != truth.time:
        yield Fault("time", truth.time, f"time is {truth.time}, taken: {_source(entry, 'csv') or '-'}")
    yield from _thruster_faults(config, truth, sign)


def _thruster_faults(config: Mapping[str, Any], truth: Folder, sign: int) -> Iterator[Fault]:
    active = {
        _source(block.get("command"), truth.format): (block["yaw_arm"] > 0) - (block["yaw_arm"] < 0)
        for block in config.get("thrusters", ())
        if "yaw_arm" in block
    }
    signals: Mapping[str, Any] = config.get("signals", {})
    if torque := signals.get("torque"):
        active[_source(torque, truth.format)] = int(torque.get("sign", 1)) if isinstance(torque, Mapping) else 1
    active.pop("", None)
    for name, way in truth.thrusters.items():
        got = active.pop(name, 0)
        if way and not got:
            yield Fault("thruster", name, f"{name} turns it {way:+d}, not taken")
        elif way and got != way * sign:
            yield Fault("thruster", name, f"{name} turns it {way * sign:+d}, taken: {got:+d}")
        elif got and not way:
            yield Fault("thruster", name, f"{name} does not turn it, taken: {got:+d}")
    for name, got in active.items():
        what = truth.decoys.get(name, "yaw rate" if name == truth.yaw_rate else "?").rstrip("0123456789")
        yield Fault("thruster", name, f"{name} ({what}) is no thruster, taken: {got:+d}")


def _aside(config: Mapping[str, Any], truth: Folder, folder: Path) -> Iterator[str]:
    """The yaw rate's source and unit; whether the guessed curve is 0 at neutral."""
    entry = config.get("signals", {}).get("yaw_rate")
    found = _source(entry, truth.format)
    unit = entry.get("unit", "rad/s") if isinstance(entry, Mapping) else "rad/s"
    if found and found != truth.yaw_rate:
        yield f"yaw rate is {truth.yaw_rate or 'nowhere'}, taken: {found}"
    elif found and unit != truth.yaw_rate_unit:
        yield f"{found} is in {truth.yaw_rate_unit}, taken: {unit}"
    for name in sorted({str(block.get("curve", "")) for block in config.get("thrusters", ())} - {""}):
        rows = [line.split(",") for line in (folder / name).read_text(encoding="utf-8").split()[1:]]
        curve = [(float(command), float(thrust)) for command, thrust in rows]
        if not any(command == truth.neutral and thrust == 0.0 for command, thrust in curve) and not (
            sum(command for command, _ in curve) == 2.0 * truth.neutral and sum(thrust for _, thrust in curve) == 0.0
        ):
            yield f"neutral is {truth.neutral:g} ({truth.kind}), {name}: {curve}"


def main() -> None:
    """Print each folder, the worst last, and how many were right."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6))
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--only", type=int, action="append", help="index of a folder; may be given again")
    parser.add_argument("--axes", action="store_true", help="folders along surge, heave and roll")
    parser.add_argument("--keep", type=Path, help="folder for the logs; it is left there")
    options = parser.parse_args()
    print(f"seed {options.seed}")
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(os.cpu_count()) as pool:

        def tried(index: int) -> tuple[str, Score]:
            folder = (options.keep or Path(name)) / f"{index:02d}"
            if options.axes:
                along = write_axis_folder(folder, seed=options.seed, index=index)
                return along.about, scored_along(folder, along)
            truth = write_folder(folder, seed=options.seed, index=index)
            marks = f"{', one file a sensor' if truth.split else ''}{', no heading' if truth.lacking else ''}"
            return truth.about + marks, scored(folder, truth)

        indices = options.only or range(options.count)
        for index, (about, score) in zip(indices, pool.map(tried, indices), strict=True):
            counts[score.verdict] += 1
            print(f"{index:02d}  {score.verdict:5}  {about}", flush=True)
            for line in (*score.faults, *(f"aside: {text}" for text in score.aside)):
                print(f"           {line}")
    print(", ".join(f"{counts[verdict]} {verdict}" for verdict in ("right", "open", "wrong")))


if __name__ == "__main__":
    main()
