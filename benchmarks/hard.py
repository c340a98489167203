"""Hard water: is the diagnosis right where waves, feedback, coupling and short logs are against it?

Run ``python -m benchmarks.hard --seed 1 --campaigns 300 --state hard.jsonl``. Each campaign is drawn by tools/hard,
which shares nothing with rovid; the tool sees files alone. Started again with the same state it goes on where it
stopped. ``--only 17`` does campaign 17 of the seed again, ``--keep FOLDER`` leaves its logs there, the truth beside.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from benchmarks.hard_page import write_page
from benchmarks.hard_scores import score
from tools.hard import VEHICLES, draw, look, write_campaign

PROJECT = Path(__file__).resolve().parents[1]
TOOL = [sys.executable, "-c", "from rovid.cli.cli import main; main()"]
# What of a diagnosis is kept in the state.
KEPT = ("verdict", "findings", "suspects", "base", "extended", "horizons", "unexplained", "warnings")


def diagnose(folder: Path, timeout: float) -> tuple[dict[str, Any] | None, str, float]:
    """Document of ``rovid diagnose``, or what went wrong; and the seconds that it took."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as room:
        command = [*TOOL, "diagnose", str(folder), "-p", str(Path(room) / "parameters.toml"), "--json"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, cwd=PROJECT, check=False)
        except subprocess.TimeoutExpired:
            return None, "no answer in time", time.monotonic() - began
    seconds = time.monotonic() - began
    if done.returncode:
        return None, f"exit {done.returncode}: {done.stderr.strip()[-400:]}", seconds
    return json.loads(done.stdout), "", seconds


def campaign_seed(seed: int, number: int) -> int:
    """Seed of one campaign."""
    return 100_000 * seed + number


def judged(seed: int, number: int, vehicle: str | None, timeout: float, keep: str | None) -> dict[str, Any]:
    """One campaign: drawn, written, looked at by the oracle, diagnosed."""
    campaign = draw(campaign_seed(seed, number), vehicle)
    truth = campaign.truth() | look(campaign)
    with tempfile.TemporaryDirectory() as room:
        folder = Path(keep) / f"hard_{number:04d}" if keep else Path(room) / "campaign"
        write_campaign(folder, campaign)
        if keep:
            (Path(keep) / f"hard_{number:04d}.truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
        said, failure, seconds = diagnose(folder, timeout)
    if said is not None:
        said = {key: said[key] for key in KEPT if key in said}
    return {
        "seed": seed, "number": number, "vehicle": vehicle, "truth": truth, "said": said, "failure": failure,
        "diagnosis_seconds": seconds,
    }  # fmt: skip


def read_state(path: Path) -> list[dict[str, Any]]:
    """Campaigns that are done already; a last line that was cut short is left out."""
    if not path.exists():
        return []
    records = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            records.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return records


def line_of(record: dict[str, Any]) -> str:
    """One campaign in a line of the terminal."""
    result = score(record)
    truth = record["truth"]
    mark = "right" if result["established_right"] else ("first" if result["first_right"] else "     ")
    wrong = " WRONG" if result["established_wrong"] else ""
    return (
        f"{record['number']:4d} {truth['vehicle']:<10} {result['hidden'] or '-':<24} visible {truth['visible']:5.2f} "
        f"R2 {truth['plain_r2']:5.2f} {record['diagnosis_seconds']:5.0f} s {mark}{wrong} "
        f"{result['verdict'][:60]} {result['names']} {result['suspected']}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--campaigns", type=int, default=30)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of campaigns to do, again if need be")
    parser.add_argument("--vehicle", choices=sorted(VEHICLES))
    parser.add_argument("--state", type=Path, required=True, help="a file of JSON lines, added to")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=1200.0, help="seconds that a diagnosis may take")
    parser.add_argument("--keep", help="folder to leave campaigns in")
    parser.add_argument("--page", type=Path, help="where to write the page, docs/hard.md for instance")
    options = parser.parse_args()
    done = [
        record
        for record in read_state(options.state)
        if record["seed"] == options.seed and record["vehicle"] == options.vehicle
    ]
    if options.only is None:
        wanted = sorted(set(range(options.campaigns)) - {record["number"] for record in done})
    else:
        wanted = options.only
        done = [record for record in done if record["number"] not in wanted]
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    options.state.parent.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(options.jobs) as pool, options.state.open("a", encoding="utf-8") as state:
        work = [
            pool.submit(judged, options.seed, number, options.vehicle, options.timeout, options.keep)
            for number in wanted
        ]
        for finished in as_completed(work):
            record = finished.result()
            done.append(record)
            state.write(json.dumps(record) + "\n")
            state.flush()
            print(line_of(record), flush=True)
    page = write_page(sorted(done, key=lambda record: record["number"]), options.page)
    print(page)


if __name__ == "__main__":
    main()
