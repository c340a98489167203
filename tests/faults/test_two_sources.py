"""Two sensors mixed in one signal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.faults.drives import drives, found, undamaged


@pytest.mark.parametrize("offset", [1.0, 7.0, -40.0, 170.0])
@pytest.mark.parametrize("strict", [True, False])
def test_the_source_with_more_readings_is_taken(offset: float, tmp_path: Path, *, strict: bool) -> None:
    drive = dict(drives(1, interval=0.05))["sine 5.0"]
    row = np.arange(len(drive.time))
    second = row % 2 == 1 if strict else np.random.default_rng(2).random(len(row)) < 0.3
    logged = np.round((drive.heading + offset * second) % 360.0, 4)
    trial = drive.trial(tmp_path, heading=logged)
    (fault,) = found(trial, "two_sources")
    assert fault.size is not None
    # Motion within an interval adds to the change of the source.
    assert np.rad2deg(fault.size) == pytest.approx(abs(offset), abs=0.2)
    assert trial.measured.sum() >= 0.5 * len(row) - 1
    first = int(np.flatnonzero(np.isclose(logged, np.rad2deg(trial.position[0]) % 360.0))[0])
    kept = first + np.rint(trial.time[trial.measured] / 0.05).astype(int)
    assert len(set(second[kept].tolist())) == 1


@pytest.mark.parametrize("seed", range(3, 7))
def test_undamaged_logs_have_one_source(seed: int, tmp_path: Path) -> None:
    assert not [name for name, trial in undamaged(seed, tmp_path) if found(trial, "two_sources")]
