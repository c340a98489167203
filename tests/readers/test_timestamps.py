"""Times in every unit, to the last digit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.readers.logs import campaign, csv_text, kinds, read_csv, standard, toml
from tests.readers.test_csv_reader import TIME, assert_standard


@pytest.mark.parametrize(("unit", "scale"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_declared_time_units(unit: str, scale: float, tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(time=f'time = {{ csv = "time_s", unit = "{unit}" }}'))
    trial = read_csv(tmp_path, csv_text(standard(time_s=np.round(TIME * scale, 3))), config)
    assert_standard(trial.position, trial.time)


def test_nanoseconds_lose_no_digit(tmp_path: Path) -> None:
    ticks = 1767787200000000001 + np.arange(400) * 50_000_007
    trial = read_csv(tmp_path, csv_text(standard(time_s=ticks)))
    np.testing.assert_allclose(trial.time, np.arange(400) * 0.050000007, rtol=0, atol=1e-13)


def test_nanoseconds_with_an_empty_cell(tmp_path: Path) -> None:
    ticks = [str(1767787200000000001 + k * 50_000_000) for k in range(400)]
    ticks[7] = ""
    trial = read_csv(tmp_path, csv_text(standard(time_s=ticks)))
    assert len(trial.time) == 399
    assert kinds(trial) == {"missing": 1}
