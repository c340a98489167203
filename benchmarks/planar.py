"""Planar campaigns: are the coupled model's parameters right, and are hidden couplings and currents named?

Run ``python -m benchmarks.planar --seed 1 --count 20 --state planar.jsonl --page docs/planar_results.md``. tools/planar
draws each campaign and shares no code with rovid; rovid sees files alone, through its command line. Started again with
the same state, the run goes on where it stopped. ``--keep FOLDER`` leaves the logs there, and the truth next to them.
``--page-only`` writes the page from the state.
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

from benchmarks.planar_page import line_of, page
from tools.planar import FAMILIES, draw, truth_of, write_campaign

PROJECT = Path(__file__).resolve().parents[1]
# The command leaves its processor time in a file, because other programs may keep the machine busy.
_TIMED = (
    "import atexit, os, pathlib, time; "
    "atexit.register(lambda: pathlib.Path(os.environ['TIMED']).write_text(str(time.process_time()))); "
    "from rovid.cli.cli import main; main()"
)
TOOL = [sys.executable, "-c", _TIMED]
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
# Keys of the documents that are kept.
KEPT = ("verdict", "findings", "suspects", "base", "extended", "parameters", "effects", "undetermined", "refused",
        "unexplained", "not_identifiable", "warnings", "faults")  # fmt: skip
# Hidden effect and form -> name for `rovid fit --effect`; the others have the effect's own name.
SPECS = {
    ("current", "wandering"): "current:wandering",
    ("sway_yaw_damping", "lift"): "sway_yaw_damping:lift",
    ("speed_dependent_damping", "linear"): "speed_dependent_damping:planar",
    ("speed_dependent_damping", "quadratic"): "speed_dependent_damping:planar_quadratic",
    ("cross_flow_drag", "offset"): "cross_flow_drag:off_centre",
    ("bias_torque", "yaw"): "bias_torque:planar",
    ("bias_torque", "sway"): "bias_torque:planar",
    ("bias_torque", "surge"): "bias_torque:planar",
}


def answer(command: str, folder: Path, timeout: float, *more: str) -> dict[str, Any]:
    """Document of ``rovid COMMAND``, or its failure; and the processor time of the command in s."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as room:
        whole = [*TOOL, command, str(folder), *more, "-p", str(Path(room) / "parameters.toml"), "--json"]
        try:
            done = subprocess.run(
                whole, capture_output=True, text=True, timeout=timeout, cwd=PROJECT, check=False,
                env=os.environ | ONE_THREAD | {"TIMED": str(Path(room) / "seconds")},
            )  # fmt: skip
            used = float((Path(room) / "seconds").read_text(encoding="utf-8"))
        except subprocess.TimeoutExpired:
            return {"failure": f"no answer in {timeout:.0f} s", "seconds": time.monotonic() - began}
    record: dict[str, Any] = {"seconds": used, "failure": ""}
    if done.returncode:
        record["failure"] = f"exit {done.returncode}: {done.stderr.strip()[-1500:]}"
    if done.stdout.strip().startswith("{"):
        document = json.loads(done.stdout)
        record |= {key: document[key] for key in KEPT if key in document}
    return record


def spec_of(truth: dict[str, Any]) -> str:
    """The hidden cause as `rovid fit --effect` takes it; empty for none."""
    if not truth["hidden"]:
        return ""
    if truth["thruster"]:
        return f"{truth['hidden']}:{truth['thruster']}"
    return SPECS.get((truth["hidden"], truth["form"]), str(truth["hidden"]))


def judged(seed: int, index: int, options: argparse.Namespace) -> dict[str, Any]:
    """One campaign: drawn, written, fitted with the true cause, diagnosed, and fitted along yaw alone."""
    campaign = draw(seed, index, options.hidden, options.family, samples=options.samples)
    truth = truth_of(campaign)
    with tempfile.TemporaryDirectory() as room:
        folder = (options.keep or Path(room)) / f"planar_{seed}_{index:04d}"
        write_campaign(folder, campaign)
        if options.keep:
            folder.with_suffix(".truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
        effect = spec_of(truth)
        more = ["--effect", effect] if effect else []
        said = {"fit": answer("fit", folder, options.timeout, "--axes", "planar", *more)}
        if "diagnose" in options.commands:
            said["diagnose"] = answer("diagnose", folder, options.timeout, "--axes", "planar")
        if "yaw" in options.commands:
            said["yaw"] = answer("fit", folder, options.timeout)
    return {"seed": seed, "index": index, "asked": [options.hidden, options.family], "truth": truth, "said": said}


def read_state(path: Path | None) -> list[dict[str, Any]]:
    """Campaigns that are done already, the last answer to each; a last line that was cut short is left out."""
    records = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path and path.exists() else []:
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue
        records[record["seed"], record["index"], str(record["asked"])] = record
    return list(records.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--hidden", metavar="none|ID|ID:FORM", help="what is hidden; random by default")
    parser.add_argument("--family", choices=list(FAMILIES), help="random by default")
    parser.add_argument("--commands", nargs="*", default=["diagnose", "yaw"], choices=["diagnose", "yaw"],
                        help="besides the planar fit")  # fmt: skip
    parser.add_argument("--samples", type=int, default=20_000, help="largest number of readings of a sensor")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=900.0, help="seconds that a command may take")
    parser.add_argument("--state", type=Path, help="a file of JSON lines, added to")
    parser.add_argument("--again", action="store_true", help="repeat campaigns that are in the state")
    parser.add_argument("--keep", type=Path, help="folder to leave campaigns in")
    parser.add_argument("--page", type=Path, help="page that is written from the whole state")
    parser.add_argument("--page-only", action="store_true", help="run nothing")
    options = parser.parse_args()
    wanted = [] if options.page_only else list(range(options.start, options.start + options.count))
    asked = [options.hidden, options.family]
    state = [one for one in read_state(options.state) if options.page_only or one["asked"] == asked]
    done = [one for one in state if not options.again or one["seed"] != options.seed or one["index"] not in wanted]
    known = {(one["seed"], one["index"]) for one in done}
    with ThreadPoolExecutor(options.jobs) as pool:
        work = [
            pool.submit(judged, options.seed, index, options) for index in wanted if (options.seed, index) not in known
        ]
        for finished in as_completed(work):
            record = finished.result()
            done.append(record)
            if options.state:
                with options.state.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(record) + "\n")
            print(line_of(record), flush=True)
    done.sort(key=lambda one: (one["seed"], one["index"]))
    text = page(done)
    print(text)
    if options.page:
        options.page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
