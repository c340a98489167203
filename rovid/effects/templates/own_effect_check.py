"""Hides the effect of own_effect.py in simulated logs; rovid has to find it."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

# The vehicle and the sizes of the effect, in SI.
INERTIA, QUADRATIC_DRAG, LINEAR_DRAG = 40.0, 30.0, 3.0
TRUTH = {"stiffness": 0.5, "slack": 1.2}
# Simulated seconds of a run, interval of the log, and steps in such an interval.
SECONDS, INTERVAL, STEPS = 120.0, 0.1, 50
CONFIG = """
[vehicle]
name = "simulated"
mass = 100.0
length = 1.5
width = 1.2

[signals]
time = { csv = "time_s" }
heading = { csv = "heading_deg", unit = "deg" }
torque = { csv = "torque_Nm" }
"""


def hidden_torque(angle: float, rate: float) -> float:
    """Torque in N m of the effect, written without rovid."""
    return -TRUTH["stiffness"] * max(angle - TRUTH["slack"], 0.0)


def simulated_log(torque: np.ndarray, seed: int) -> str:
    """CSV of a run under a (n,) torque in N m, with heading noise of 0.1 deg."""
    rng = np.random.default_rng(seed)
    start, angle, rate, rows = rng.uniform(0.0, 360.0), 0.0, 0.0, ["time_s,heading_deg,torque_Nm"]
    for k, push in enumerate(torque.tolist()):
        heading = (start + np.degrees(angle) + rng.normal(0.0, 0.1)) % 360.0
        rows.append(f"{k * INTERVAL:.1f},{heading:.4f},{push:.4f}")
        for _ in range(STEPS):
            drag = (QUADRATIC_DRAG * abs(rate) + LINEAR_DRAG) * rate
            rate += INTERVAL / STEPS * (push - drag + hidden_torque(angle, rate)) / INERTIA
            angle += INTERVAL / STEPS * rate
    return "\n".join(rows) + "\n"


def write_campaign(folder: Path) -> None:
    """Six runs: sines, holds in both directions, and random steps."""
    (folder / "rovid.toml").write_text(CONFIG, encoding="utf-8")
    time = np.arange(0.0, SECONDS, INTERVAL)
    levels = np.random.default_rng(7).choice([-3.0, -1.5, 0.0, 1.5, 3.0], size=(2, 40))
    runs = {
        "sine_20s": 3.0 * np.sin(2.0 * np.pi * time / 20.0),
        "sine_35s": 2.5 * np.sin(2.0 * np.pi * time / 35.0),
        "hold_plus": np.where(time % 80.0 < 50.0, 2.5, 0.0),
        "hold_minus": np.where(time % 80.0 < 50.0, -2.5, 0.0),
        "steps_a": levels[0][(time // 8.0).astype(int)],
        "steps_b": levels[1][(time // 5.0).astype(int)],
    }
    for seed, (name, torque) in enumerate(runs.items()):
        (folder / f"{name}.csv").write_text(simulated_log(torque, seed), encoding="utf-8")


def test_the_effect_is_found(tmp_path: Path) -> None:
    write_campaign(tmp_path)
    plugin, parameters = Path(__file__).with_name("own_effect.py"), tmp_path / "parameters.toml"
    command = [sys.executable, "-m", "rovid", "diagnose", str(tmp_path), "-p", str(parameters), "--json"]
    options = ["--effects-from", str(plugin), "--budget", "900"]
    done = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["findings"]
    assert [finding["effect"] for finding in found] == ["own_effect"]
    for name, truth in TRUTH.items():
        estimate = found[0]["parameters"][name]
        assert abs(estimate["value"] - truth) < 4.0 * estimate["standard_error"] + 0.02 * truth
