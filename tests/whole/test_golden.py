"""Golden campaigns: every number and every name that the commands print of two sample campaigns is the recorded one.

Renew after a wanted change, and look at the difference: ``python -m tests.whole.test_golden``.
"""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = Path(__file__).parent / "golden"
# Arguments of each command that takes the parameters of a fit; the others take the logs.
WITH_PARAMETERS = {"plan": ["--minutes", "3"], "control": [], "export": ["mss", "-o", "vehicle.m"]}
CASES = [(folder, command) for folder in ("rosub_hidden", "planar_rov") for command in ("fit", "diagnose", "simulate")]
CASES += [("rosub_hidden", command) for command in ("check", *WITH_PARAMETERS)]
RELATIVE = 1e-6  # asked for; the same code on the same machine gives the same bits
# Verdicts, and names of effects, parameters and logs; sentences may be worded anew.
NAME = re.compile(r"[\w.:]+")
# What a clock or a release changes, and no estimate.
_NOT_HELD = frozenset({"written", "rovid_version", "seconds", "took", "elapsed", "used"})


def numbers(value: Any, where: str = "") -> Iterator[tuple[str, float | str | bool | None]]:
    """(path, value) of each leaf of a document."""
    if isinstance(value, dict):
        for key, one in value.items():
            if key not in _NOT_HELD:
                yield from numbers(one, f"{where}.{key}")
    elif isinstance(value, list):
        for place, one in enumerate(value):
            yield from numbers(one, f"{where}[{place}]")
    elif isinstance(value, int | float | bool) or value is None or NAME.fullmatch(value):
        yield where, value


def printed(folder: str, command: str) -> dict[str, Any]:
    """Numbers that a command prints, to ten digits."""
    with tempfile.TemporaryDirectory() as room:
        logs, ending = [str(ROOT / "sample_logs" / folder)], ["-p", str(Path(room) / "p.toml"), "--json"]
        if folder.startswith("planar"):
            ending += ["--axes", "planar"]
        if command == "check":
            ending = ["--json"]
        elif command not in {"fit", "diagnose"}:  # they need parameters
            _run(["fit", *logs, *ending], room)
        document = json.loads(_run([command, *WITH_PARAMETERS.get(command, logs), *ending], room))
    return {
        place: float(f"{value:.10g}") if isinstance(value, float) and math.isfinite(value) else value
        for place, value in numbers(document)
    }


def _run(words: list[str], room: str) -> str:
    # No budget ends a search early on a loaded machine.
    environment = os.environ | {"ROVID_BUDGET": "3600", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-m", "rovid", *words], capture_output=True, text=True, env=environment, cwd=room, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(("folder", "command"), CASES)
def test_every_number_is_the_recorded_one(folder: str, command: str) -> None:
    recorded = json.loads((GOLDEN / f"{folder}_{command}.json").read_text(encoding="utf-8"))
    now = printed(folder, command)
    assert now.keys() == recorded.keys()
    changed = {place: (recorded[place], value) for place, value in now.items() if not same(recorded[place], value)}
    assert not changed


def same(a: Any, b: Any) -> bool:
    """Whether two leaves are equal, numbers within the tolerance."""
    if isinstance(a, float) and isinstance(b, int | float):
        return math.isclose(a, b, rel_tol=RELATIVE, abs_tol=1e-12)
    return bool(a == b)


def main() -> None:
    """Record what is printed today."""
    GOLDEN.mkdir(exist_ok=True)
    for folder, command in CASES if len(sys.argv) == 1 else [case for case in CASES if case[1] in sys.argv]:
        text = json.dumps(printed(folder, command), separators=(",\n", ":"))
        (GOLDEN / f"{folder}_{command}.json").write_text(text + "\n", encoding="utf-8", newline="\n")
        print(f"{folder}_{command}.json")


if __name__ == "__main__":
    main()
