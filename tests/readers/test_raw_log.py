"""What all readers ask of a log before they unpack it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import ConfigError, LogError
from rovid.readers.raw_log import (
    Columns,
    RawLog,
    numeric_sources,
    raw_log_of_topics,
    require_library,
    required_signals,
    required_time,
    select_instance,
    split_instance,
    wrong_format,
)
from rovid.readers.timestamps import is_plausible
from rovid.signals.segments import subsampled_median
from rovid.trial.axis import Signal
from rovid.trial.config import Config
from rovid.trial.trial import Remark


def test_a_format_without_a_source_of_what_is_needed_is_refused(config: Config, tmp_path: Path) -> None:
    assert {"heading", "command.fore"} <= set(required_signals(config, "csv", tmp_path / "a.csv"))
    with pytest.raises(ConfigError, match="heading names no tlog source"):
        required_signals(config, "tlog", tmp_path / "a.tlog")


def test_the_time_has_to_be_named_for_tables(config: Config) -> None:
    assert required_time(config, "csv").sources["csv"] == "time_s"
    with pytest.raises(ConfigError, match="time names no parquet column"):
        required_time(config, "parquet")


def test_a_package_that_is_not_there_is_named_with_its_extra() -> None:
    with pytest.raises(LogError, match=r"needs the package no_such_package.*rovid\[logs\]"):
        require_library("no_such_package.inside", "logs", Path("a.bag"))


def test_a_foreign_file_is_told_from_an_empty_one(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("x")
    (tmp_path / "b").write_text("")
    assert "does not begin as one" in str(wrong_format(tmp_path / "a", "a log"))
    assert "it is empty" in str(wrong_format(tmp_path / "b", "a log"))


def test_what_no_sensor_measures_is_not_sensible() -> None:
    assert is_plausible(np.array([0.0, -1e9, np.nan, np.inf, 1e16])).tolist() == [True, True, False, False, False]


def test_the_typical_value_is_near_the_median_of_many() -> None:
    values = np.random.default_rng(1).normal(5.0, 1.0, 1_000_000)
    # Of 10 000 the median is known to 0.0125 standard deviations.
    assert subsampled_median(values) == pytest.approx(np.median(values), abs=0.06)
    assert np.isnan(subsampled_median(np.empty(0)))


# --- topics as columns: sensors told apart, and what can be taken from a topic

LOG = Path("a.bin")
# A clock that began long ago: to the us no float would hold it.
BEGIN = 1_700_000_000_000_000
ATT: Columns = {
    "time": BEGIN + np.array([0, 50_000, 100_000]),
    "yaw": np.array([1.0, 2.0, 3.0]),
    "mode": np.array(["a", "b", "c"]),
}
OUT: Columns = {"time": (BEGIN + np.array([20_000, 120_000])).astype(np.uint64), "c1": np.array([1500, 1600])}
TOPICS = {"ATT": ATT, "OUT": OUT}


def signal(name: str, source: str, *, optional: bool = False) -> Signal:
    return Signal(name=name, sources={"bin": source}, optional=optional)


def raw(signals: dict[str, Signal]) -> RawLog:
    return raw_log_of_topics(LOG, "bin", signals, TOPICS.__getitem__, "time", [])


def test_all_topics_count_from_the_first_message_of_any() -> None:
    signals = {"heading": signal("heading", "ATT.yaw"), "command.a": signal("command.a", "OUT.c1")}
    found = raw(signals).channels
    assert found["heading"].time == pytest.approx([0.0, 0.05, 0.1], abs=1e-12)
    assert found["command.a"].time == pytest.approx([0.02, 0.12], abs=1e-12)
    assert found["command.a"].values.tolist() == [1500.0, 1600.0]


def test_a_field_that_is_missing_or_text_is_refused_unless_nobody_asked_for_it() -> None:
    for source, words in (("ATT.roll", "ATT has no field 'roll'"), ("ATT.mode", "ATT.mode .* is text")):
        with pytest.raises(LogError, match=words):
            raw({"roll": signal("roll", source)})
    both = {"heading": signal("heading", "ATT.yaw"), "roll": signal("roll", "ATT.roll", optional=True)}
    assert set(raw(both).channels) == {"heading"}


def test_numbers_are_sources_and_clocks_and_text_are_not() -> None:
    quaternion = {f"q[{k}]": np.zeros(1) for k in range(4)}
    assert numeric_sources({**TOPICS, "att": quaternion}) == ["ATT.yaw", "OUT.c1", "att.q"]


def test_one_sensor_of_several_is_taken_and_said() -> None:
    assert split_instance("IMU[1]") == ("IMU", 1)
    assert split_instance("IMU") == ("IMU", None)
    columns: Columns = {"I": np.array([0, 1, 0, 1]), "gz": np.array([0.0, 10.0, 1.0, 11.0])}
    remarks: list[Remark] = []
    assert select_instance(LOG, "bin", "IMU", columns, "I", remarks)["gz"].tolist() == [0.0, 1.0]
    assert "IMU[1] is another" in remarks[0].text
    assert select_instance(LOG, "bin", "IMU[1]", columns, "I", remarks)["gz"].tolist() == [10.0, 11.0]
    assert len(remarks) == 1
    with pytest.raises(LogError, match=r"holds no message 'IMU\[2\]'"):
        select_instance(LOG, "bin", "IMU[2]", columns, "I", remarks)
