"""Time as serial days of a spreadsheet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.readers.timestamps import to_seconds
from tests.readers.logs import csv_text, read_csv


@pytest.mark.parametrize(("decimals", "exact"), [(12, 2e-5), (5, 0.45)])
def test_serial_days_are_read(decimals: int, exact: float, tmp_path: Path) -> None:
    """With all digits, and with the few that a cell shows, which is a clock of 0.864 s."""
    time = np.linspace(0.0, 150.0, 1501)
    days = np.round(46000.58 + time / 86400.0, decimals)
    columns = {"time_s": days, "heading_deg": (5.0 * time) % 360.0, "fore_V": np.sin(0.3 * time)}
    text = csv_text({name: [f"{value:.{decimals}f}" for value in column] for name, column in columns.items()})
    trial = read_csv(tmp_path, text)
    assert trial.duration == pytest.approx(150.0, abs=0.9 if decimals == 5 else exact)
    np.testing.assert_allclose(trial.time[: len(time)], time[: len(trial.time)], atol=exact)


def test_seconds_of_the_same_size_stay_seconds() -> None:
    """Noon in seconds of the day is 43200, and a log at 20 Hz."""
    noon = 43200.0 + 0.05 * np.arange(1000)
    np.testing.assert_array_equal(to_seconds(noon, "time", "auto"), noon)
    days = 46000.0 + 1e-6 * np.arange(1000)
    np.testing.assert_array_equal(to_seconds(days, "time", "s"), days)
