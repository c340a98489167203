"""What all readers ask of a log before they unpack it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import ConfigError, LogError
from rovid.readers.raw_log import (
    foreign,
    is_plausible,
    mapped,
    require_library,
    require_room,
    subsampled_median,
    time_signal,
)
from rovid.trial.config import Config


def test_a_format_without_a_source_of_what_is_needed_is_refused(config: Config, tmp_path: Path) -> None:
    assert {"heading", "command.fore"} <= set(mapped(config, "csv", tmp_path / "a.csv"))
    with pytest.raises(ConfigError, match="heading names no tlog source"):
        mapped(config, "tlog", tmp_path / "a.tlog")


def test_the_time_has_to_be_named_for_tables(config: Config) -> None:
    assert time_signal(config, "csv").sources["csv"] == "time_s"
    with pytest.raises(ConfigError, match="time names no parquet column"):
        time_signal(config, "parquet")


def test_a_package_that_is_not_there_is_named_with_its_extra() -> None:
    with pytest.raises(LogError, match=r"needs the package no_such_package.*rovid\[logs\]"):
        require_library("no_such_package.inside", "logs", Path("a.bag"))


def test_a_table_beyond_the_room_of_a_log_is_refused_before_it_is_unpacked() -> None:
    require_room(Path("a"), 1_000_000, 60)
    with pytest.raises(LogError, match="holds 1000000 rows, of which 70 columns"):
        require_room(Path("a"), 1_000_000, 70)


def test_a_foreign_file_is_told_from_an_empty_one(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("x")
    (tmp_path / "b").write_text("")
    assert "does not begin as one" in str(foreign(tmp_path / "a", "a log"))
    assert "it is empty" in str(foreign(tmp_path / "b", "a log"))


def test_what_no_sensor_measures_is_not_sensible() -> None:
    assert is_plausible(np.array([0.0, -1e9, np.nan, np.inf, 1e16])).tolist() == [True, True, False, False, False]


def test_the_typical_value_is_near_the_median_of_many() -> None:
    values = np.random.default_rng(1).normal(5.0, 1.0, 1_000_000)
    # Of 10 000 the median is known to 0.0125 standard deviations.
    assert subsampled_median(values) == pytest.approx(np.median(values), abs=0.06)
    assert np.isnan(subsampled_median(np.empty(0)))
