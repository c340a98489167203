"""Times in every unit, to the last digit; samples out of order, repeated, or on an impossible clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import LogError
from tests.readers.channels import HEADING, TIME
from tests.readers.logs import campaign, csv_text, kinds, read_csv, standard, toml
from tests.readers.test_csv_reader import assert_standard


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


def test_duplicates_keep_the_first(tmp_path: Path) -> None:
    text = csv_text(standard()).split("\n")
    text.insert(100, text[99].replace(",", ",9", 1))
    text.insert(200, text[199])
    trial = read_csv(tmp_path, "\n".join(text))
    assert kinds(trial) == {"duplicate": 2}
    np.testing.assert_allclose(trial.position, np.deg2rad(HEADING), atol=2e-6)


def test_a_clock_without_order_is_refused(tmp_path: Path) -> None:
    time = TIME.copy()
    np.random.default_rng(1).shuffle(time)
    with pytest.raises(LogError, match=r"time_s runs backwards at line \d+, from"):
        read_csv(tmp_path, csv_text(standard(time_s=time)))


def test_coarse_stamps_that_hide_gaps_are_refused(tmp_path: Path) -> None:
    time = np.floor(TIME / 5.0) ** 3
    with pytest.raises(LogError, match=r"repeats the stamp before it in 396 of 400.*more decimals"):
        read_csv(tmp_path, csv_text(standard(time_s=time)))


def test_a_kept_step_is_refused(tmp_path: Path) -> None:
    time = TIME.copy()
    time[200:] -= 5.0
    config = campaign(tmp_path, toml() + '[faults]\nclock_step = "keep"\n')
    text = csv_text(standard(time_s=time))
    with pytest.raises(LogError, match=r"time_s runs backwards at line 202, from 9\.95 s to 5 s"):
        read_csv(tmp_path, text, config)


def test_a_kept_leap_is_refused(tmp_path: Path) -> None:
    time = TIME.copy()
    time[20:] += 1.7e9
    config = campaign(tmp_path, toml() + '[faults]\nclock_step = "keep"\n')
    with pytest.raises(LogError, match=r"leaps by 1\.7e\+09 s after sample 20"):
        read_csv(tmp_path, csv_text(standard(time_s=time)), config)
