"""A logger that writes each row at the end of its interval, found from the files alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Rovid

CONFIG = """
[[thrusters]]
name = "stern"
yaw_arm = 1.0
thrust_constant = 2.0
max_command = 10.0
command = { csv = "command" }
[signals]
time = { csv = "time" }
heading = { csv = "heading" }
"""
INTERVAL, INERTIA, DRAG = 0.5, 40.0, 30.0


def write_late_stamps(folder: Path) -> None:
    """Three logs of a vehicle of one degree of freedom; a row holds the command of the interval that ends with it."""
    rng = np.random.default_rng(8)
    (folder / "rovid.toml").write_text(CONFIG)
    substeps = 50
    for log in range(3):
        command = np.repeat(rng.uniform(-4.0, 4.0, 40), rng.integers(8, 20, 40))
        rows, heading, rate = [], 0.0, 0.0
        for number, now in enumerate(command):
            for _ in range(substeps):
                torque = 2.0 * now * abs(now) + rng.normal(0.0, 4.0)
                step = (torque - DRAG * rate * (1.0 + abs(rate))) / INERTIA * INTERVAL / substeps
                heading += (rate + 0.5 * step) * INTERVAL / substeps
                rate += step
            rows.append((INTERVAL * (number + 1), now, np.degrees(heading) + rng.normal(0.0, 0.05)))
        np.savetxt(folder / f"run_{log}.csv", rows, delimiter=",", header="time,command,heading", comments="")


@pytest.mark.slow
def test_late_stamps_are_a_fault_and_no_cause(tmp_path: Path, rovid: Rovid) -> None:
    write_late_stamps(tmp_path)
    document = rovid("diagnose", tmp_path, "-p", tmp_path / "p.toml", "--force", "--json").document
    (fault,) = document["faults"]
    assert (fault["fault"], len(fault["logs"])) == ("clocks_apart", 3)
    assert fault["size"] == pytest.approx(-INTERVAL, abs=3.0 * fault["standard_error"])
    assert document["findings"] == document["suspects"] == []
    inertia = document["base"]["parameters"]["inertia"]
    assert inertia["value"] == pytest.approx(INERTIA, abs=3.0 * inertia["standard_error"])
