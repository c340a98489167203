"""Wide campaigns: is the diagnosis right on vehicles over decades of size, time constant, rates and causes?

Run ``python -m benchmarks.wide --seed 1 --count 100 --state wide.jsonl``. tools/wide draws each campaign and shares no
code with rovid; rovid sees files alone. Started again with the same state, the run goes on where it stopped.
``--start 17 --count 1 --again`` repeats campaign 17. ``--keep FOLDER`` leaves its logs there, and the truth next to
them.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from benchmarks.wide_page import line_of, section, write_section
from tools.wide import FORMS, draw, truth_of, write_campaign

PROJECT = Path(__file__).resolve().parents[1]
TOOL = [sys.executable, "-c", "from rovid.cli.cli import main; main()"]
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
# Keys of the documents that are kept.
KEPT = {
    "diagnose": ("verdict", "findings", "suspects", "base", "extended", "unexplained", "faults", "challengers",
                 "budget", "warnings"),
    "fit": ("parameters", "effects", "log_likelihood", "innovations_white", "warnings"),
}  # fmt: skip


def answer(command: str, folder: Path, timeout: float, *more: str) -> dict[str, Any]:
    """Document of ``rovid COMMAND``, or its failure; and the seconds that the command took."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as room:
        whole = [*TOOL, command, str(folder), *more, "-p", str(Path(room) / "parameters.toml"), "--json"]
        try:
            done = subprocess.run(
                whole, capture_output=True, text=True, timeout=timeout, cwd=PROJECT, check=False,
                env=os.environ | ONE_THREAD,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return {"failure": f"no answer in {timeout:.0f} s", "seconds": time.monotonic() - began}
    record: dict[str, Any] = {"seconds": time.monotonic() - began, "failure": ""}
    if done.returncode:
        record["failure"] = f"exit {done.returncode}: {done.stderr.strip()[-600:]}"
    if done.stdout.strip().startswith("{"):
        document = json.loads(done.stdout)
        record |= {key: document[key] for key in KEPT[command] if key in document}
    return record


def judged(
    seed: int, index: int, effect: str | None, timeout: float, keep: Path | None, with_fit: bool
) -> dict[str, Any]:
    """One campaign: drawn, written, diagnosed, and fitted with the true cause."""
    campaign = draw(seed, index, effect)
    truth = truth_of(campaign, refit=True)
    with tempfile.TemporaryDirectory() as room:
        folder = (keep or Path(room)) / f"wide_{seed}_{index:04d}{f'_{effect}' if effect else ''}"
        write_campaign(folder, campaign)
        if keep:
            folder.with_suffix(".truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
        said = {"diagnose": answer("diagnose", folder, timeout)}
        if with_fit:
            name = truth["effect"] and ":".join(filter(None, [truth["effect"], truth["weak_thruster"]]))
            said["fit"] = answer("fit", folder, timeout, *(["--effect", name] if name else []))
    return {"seed": seed, "index": index, "asked": effect, "truth": truth, "said": said}


def read_state(path: Path | None) -> list[dict[str, Any]]:
    """Campaigns that are done already, the last answer to each; a last line that was cut short is left out."""
    records = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path and path.exists() else []:
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue
        records[record["seed"], record["index"], record.get("asked")] = record
    return list(records.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--effect", choices=["none", *FORMS], help="what is hidden; random by default")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=300.0, help="seconds that a command may take")
    parser.add_argument("--state", type=Path, help="a file of JSON lines, added to")
    parser.add_argument("--again", action="store_true", help="repeat campaigns that are in the state")
    parser.add_argument("--keep", type=Path, help="folder to leave campaigns in")
    parser.add_argument("--no-fit", action="store_true", help="diagnose alone")
    parser.add_argument("--revision", default="", help="revision of rovid that is measured, for the page")
    parser.add_argument("--page", type=Path, help="page whose section is replaced, docs/confusion.md for instance")
    options = parser.parse_args()
    wanted = set(range(options.start, options.start + options.count))
    state = [
        record
        for record in read_state(options.state)
        if (record["seed"], record.get("asked")) == (options.seed, options.effect)
    ]
    done = [] if options.again else [record for record in state if record["index"] in wanted]
    wanted -= {record["index"] for record in done}
    with ThreadPoolExecutor(options.jobs) as pool:
        work = [
            pool.submit(judged, options.seed, index, options.effect, options.timeout, options.keep, not options.no_fit)
            for index in sorted(wanted)
        ]
        for finished in as_completed(work):
            record = finished.result()
            done.append(record)
            if options.state:
                with options.state.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(record) + "\n")
            print(line_of(record), flush=True)
    done.sort(key=lambda record: record["index"])
    print(section(done, options.revision))
    if options.page:
        write_section(options.page, done, options.revision)


if __name__ == "__main__":
    main()
