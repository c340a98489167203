"""Dirty logs: is the fault named, and is nothing else held against the vehicle?

Run ``python -m benchmarks.dirty --seed 1 --count 5 --state dirty.jsonl``: ``count`` folders of each fault and of
undamaged logs. The folders are drawn by tools/dirty, which shares no code with rovid. The tool sees files alone. With
the same state the benchmark goes on where it stopped. ``--keep FOLDER`` leaves the logs there.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from benchmarks.dirty_page import line_of, table, write_page
from benchmarks.dirty_scores import score
from tools.dirty import FAULTS, HIDDEN, write_folder

PROJECT = Path(__file__).resolve().parents[1]
TOOL = [sys.executable, "-c", "from rovid.cli.cli import main; main()"]
UNDAMAGED = "none"
# Keys of the documents that the scores need.
KEPT: Mapping[str, tuple[str, ...]] = {
    "check": ("verdict", "faults", "advice", "unreadable", "remarks"),
    "fit": ("parameters", "faults", "warnings", "innovations_white"),
    "diagnose": ("verdict", "faults", "findings", "suspects", "warnings"),
}


def answer(command: str, folder: Path, timeout: float) -> dict[str, Any]:
    """Document of ``rovid COMMAND``, or its failure; and the seconds of processor time that the command took."""
    began = _spent()
    with tempfile.TemporaryDirectory() as room:
        output = [] if command == "check" else ["-p", str(Path(room) / "parameters.toml")]
        whole = [*TOOL, command, str(folder), *output, "--json"]
        try:
            done = subprocess.run(whole, capture_output=True, text=True, timeout=timeout, cwd=PROJECT, check=False)
        except subprocess.TimeoutExpired:
            return {"failure": "no answer in time", "exit": None, "seconds": _spent() - began}
    record: dict[str, Any] = {"exit": done.returncode, "seconds": _spent() - began, "failure": ""}
    if done.stdout.strip().startswith("{"):
        document = json.loads(done.stdout)
        record |= {key: document[key] for key in KEPT[command] if key in document}
    if done.returncode or "Traceback" in done.stderr:
        record["failure"] = done.stderr.strip()[-1000:]
    return record


def _spent() -> float:
    """Processor time in s of all commands so far: other programs make a command wait, and not work."""
    return sum(os.times()[2:4])


def judged(seed: int, number: int, fault: str, hidden: str | None, timeout: float, keep: Path | None) -> dict[str, Any]:
    """One folder: drawn, written, checked, fitted, diagnosed."""
    with tempfile.TemporaryDirectory() as room:
        folder = (keep or Path(room)) / fault / f"{number:03d}"
        truth = write_folder(folder, seed, number, None if fault == UNDAMAGED else fault, hidden)
        if keep:
            folder.with_suffix(".json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
        said = {command: answer(command, folder, timeout) for command in KEPT}
    return {"seed": seed, "number": number, "kind": fault, "hidden": hidden, "truth": truth, "said": said}


def read_state(path: Path | None) -> list[dict[str, Any]]:
    """Folders that are done already; a last line that was cut short is left out."""
    records = []
    for line in path.read_text(encoding="utf-8").splitlines() if path and path.exists() else []:
        try:
            records.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return records


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=5, help="folders of each fault")
    parser.add_argument("--fault", nargs="*", choices=[UNDAMAGED, *FAULTS], default=[UNDAMAGED, *FAULTS])
    parser.add_argument("--hide", choices=HIDDEN, help="an effect that acts as well")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=120.0, help="seconds that a command may take")
    parser.add_argument("--state", type=Path, help="a file of JSON lines, added to")
    parser.add_argument("--keep", type=Path, help="folder to leave the logs in")
    parser.add_argument("--page", type=Path, help="where to write the page, docs/dirty.md for instance")
    options = parser.parse_args()
    done = [
        record
        for record in read_state(options.state)
        if (record["seed"], record["hidden"]) == (options.seed, options.hide) and record["kind"] in options.fault
    ]
    known = {(record["kind"], record["number"]) for record in done}
    wanted = [(n, kind) for n in range(options.count) for kind in options.fault if (kind, n) not in known]
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    with ProcessPoolExecutor(options.jobs) as pool:
        work = [
            pool.submit(judged, options.seed, number, kind, options.hide, options.timeout, options.keep)
            for number, kind in wanted
        ]
        for finished in as_completed(work):
            record = finished.result()
            done.append(record)
            if options.state:
                with options.state.open("a", encoding="utf-8") as state:
                    state.write(json.dumps(record) + "\n")
            print(line_of(record, score(record)), flush=True)
    done.sort(key=lambda record: (record["kind"], record["number"]))
    print(table(done))
    if options.page:
        write_page(done, options.page)


if __name__ == "__main__":
    main()
