"""Made-up folders along other axes hold what is said of them."""

from __future__ import annotations

import secrets
from pathlib import Path

import numpy as np
import pytest

from tests.tools.test_folders import table
from tools.axis_folders import AXES, write_axis_folder


@pytest.mark.parametrize("index", range(6))
def test_a_folder_holds_what_is_said_of_it(index: int, tmp_path: Path) -> None:
    seed = secrets.randbelow(10**6)
    truth = write_axis_folder(tmp_path, seed=seed, index=index)
    assert truth.axis == AXES[index % 3]
    for path in tmp_path.glob("*.csv"):
        log = table(path)
        assert {truth.measured, truth.time, *truth.thrusters} <= set(log), f"seed {seed}: {truth}"
        assert all(np.ptp(log[name]) > 0.0 for name in truth.thrusters)


def test_a_vehicle_moves_as_its_thrusters_push(tmp_path: Path) -> None:
    truth = write_axis_folder(tmp_path, seed=4, index=0)
    for path in tmp_path.glob("*.csv"):
        log = table(path)
        speed = log[truth.measured]
        late = speed[30:]
        for name, way in truth.thrusters.items():
            pushed = np.convolve(log[name] - np.median(log[name]), np.ones(30) / 30.0, "full")[: len(speed)][30:]
            alike = float(np.corrcoef(late, pushed)[0, 1])
            assert alike * way > 0.1 or not way, f"{path.name}: {name}"
