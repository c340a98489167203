"""Parameter files with extreme values: each command ends within seconds, with a result or one message."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Rovid

TOML = """
[vehicle]
mass = 100.0
[signals]
time = { csv = "time_s" }
heading = { csv = "heading_deg", unit = "deg" }
[[thrusters]]
name = "bow"
yaw_arm = 0.5
command = { csv = "bow" }
curve = "curve.csv"
"""
# s of processor time and bytes of memory for one command. A command takes about 2 s and 0.4 GB of them.
SECONDS, BYTES = 40, 6_000_000_000
COMMANDS = (
    ("simulate",),
    ("control", "--json"),
    ("plan", "--minutes", "1", "-o", "plan.csv", "--force"),
    ("export", "json", "-o", "model.json", "--force"),
    ("report", "--no-diagnosis", "--force"),
)
LAG, MEMORY = "thruster_lag.time_constant", "added_mass_memory.time_constant"
EXTREMES: dict[str, tuple[str | None, dict[str, float]]] = {
    "heavy": (None, {"inertia": 1e12, "quadratic_drag": 1e-9, "linear_drag": 1e-9}),
    "light": (None, {"inertia": 1e-9, "quadratic_drag": 1e12, "linear_drag": 1e12}),
    "instant lag": ("thruster_lag", {LAG: 1e-12}),
    "endless lag": ("thruster_lag", {LAG: 1e9}),
    "instant memory": ("added_mass_memory", {MEMORY: 1e-12}),
    "endless memory": ("added_mass_memory", {MEMORY: 1e9}),
}


def write_campaign(folder: Path) -> None:
    """One log of 60 s at 10 Hz of a vehicle with 20 kg m^2 under steps, with rovid.toml."""
    folder.mkdir()
    (folder / "rovid.toml").write_text(TOML, encoding="utf-8")
    (folder / "curve.csv").write_text("command,thrust_N\n-1,-40\n0,0\n1,40\n", encoding="utf-8")
    rng = np.random.default_rng(4)
    commands = np.repeat(rng.uniform(-1.0, 1.0, 20), 30)
    rate, heading, rows = 0.0, 1.0, ["time_s,heading_deg,bow"]
    for k, command in enumerate(commands):
        rows.append(f"{0.1 * k:.1f},{np.degrees(heading) + 0.02 * rng.normal():.3f},{command:.4f}")
        rate += 0.1 * (20.0 * command - 40.0 * abs(rate) * rate - 8.0 * rate) / 20.0
        heading += 0.1 * rate
    (folder / "run.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


def limit() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))


@pytest.mark.slow
@pytest.mark.parametrize("extreme", EXTREMES)
def test_extreme_parameters_end_in_a_result_or_one_message(extreme: str, tmp_path: Path, rovid: Rovid) -> None:
    effect, values = EXTREMES[extreme]
    write_campaign(tmp_path / "day")
    assert rovid("fit", "day", *(("--effect", effect) if effect else ())).code == 0
    path = tmp_path / "parameters.toml"
    text = path.read_text(encoding="utf-8")
    for name, value in values.items():
        text, count = re.subn(rf'(\[parameters\."?{re.escape(name)}"?\]\nvalue = )\S+', rf"\g<1>{value!r}", text)
        assert count == 1, text
    path.write_text(text, encoding="utf-8")
    for command in COMMANDS:
        done = subprocess.run(
            [sys.executable, "-m", "rovid", *command],
            cwd=tmp_path,
            env={**os.environ, "ROVID_CORES": "1"},
            preexec_fn=limit,
            capture_output=True,
            text=True,
            timeout=10 * SECONDS,
            check=False,
        )
        assert done.returncode in {0, 2}, (command, done.returncode, done.stderr)
        assert "Traceback" not in done.stderr, (command, done.stderr)
        if done.returncode == 2:
            assert done.stderr.count("rovid: ") == 1, (command, done.stderr)
