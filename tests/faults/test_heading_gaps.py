"""A heading that is absent in bursts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.faults.drives import drives, found, undamaged


def test_gaps_are_counted_and_left_open(tmp_path: Path) -> None:
    drive = dict(drives(1))["sine 5.0"]
    cells = [f"{value:.3f}" for value in drive.heading % 360.0]
    for first, last in ((100, 130), (300, 309)):
        cells[first:last] = [""] * (last - first)
    trial = drive.trial(tmp_path, heading=cells)
    (fault,) = found(trial, "heading_gaps")
    assert fault.at == pytest.approx((9.9, 29.9))
    assert fault.size == pytest.approx(3.1 + 1.0)
    assert "in 2 gaps, 4.1 s in all, the longest of 3.1 s from 9.9 s on" in fault.text
    assert not np.isfinite(trial.position[100:130]).any()


@pytest.mark.parametrize("seed", [2, 3])
def test_undamaged_logs_have_no_gaps(seed: int, tmp_path: Path) -> None:
    assert not [name for name, trial in undamaged(seed, tmp_path) if found(trial, "heading_gaps")]
