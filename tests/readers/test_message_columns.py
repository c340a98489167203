"""Messages as columns: sensors told apart, and what can be taken from a topic."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import LogError
from rovid.readers.message_columns import Columns, channels_of, numeric_sources, of_sensor, split_sensor
from rovid.trial.signal_names import Signal
from rovid.trial.trial import Remark

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


def test_all_topics_count_from_the_first_message_of_any() -> None:
    signals = {"heading": signal("heading", "ATT.yaw"), "command.a": signal("command.a", "OUT.c1")}
    found = channels_of(LOG, "bin", signals, TOPICS.__getitem__, "time")
    assert found["heading"].time == pytest.approx([0.0, 0.05, 0.1], abs=1e-12)
    assert found["command.a"].time == pytest.approx([0.02, 0.12], abs=1e-12)
    assert found["command.a"].values.tolist() == [1500.0, 1600.0]


def test_a_field_that_is_missing_or_text_is_refused_unless_nobody_asked_for_it() -> None:
    for source, words in (("ATT.roll", "ATT has no field 'roll'"), ("ATT.mode", "ATT.mode .* is text")):
        with pytest.raises(LogError, match=words):
            channels_of(LOG, "bin", {"roll": signal("roll", source)}, TOPICS.__getitem__, "time")
    both = {"heading": signal("heading", "ATT.yaw"), "roll": signal("roll", "ATT.roll", optional=True)}
    assert set(channels_of(LOG, "bin", both, TOPICS.__getitem__, "time")) == {"heading"}


def test_numbers_are_sources_and_clocks_and_text_are_not() -> None:
    quaternion = {f"q[{k}]": np.zeros(1) for k in range(4)}
    assert numeric_sources({**TOPICS, "att": quaternion}) == ["ATT.yaw", "OUT.c1", "att.q"]


def test_one_sensor_of_several_is_taken_and_said() -> None:
    assert split_sensor("IMU[1]") == ("IMU", 1)
    assert split_sensor("IMU") == ("IMU", None)
    columns: Columns = {"I": np.array([0, 1, 0, 1]), "gz": np.array([0.0, 10.0, 1.0, 11.0])}
    remarks: list[Remark] = []
    assert of_sensor(LOG, "bin", "IMU", columns, "I", remarks)["gz"].tolist() == [0.0, 1.0]
    assert "IMU[1] is another" in remarks[0].text
    assert of_sensor(LOG, "bin", "IMU[1]", columns, "I", remarks)["gz"].tolist() == [10.0, 11.0]
    assert len(remarks) == 1
    with pytest.raises(LogError, match=r"holds no message 'IMU\[2\]'"):
        of_sensor(LOG, "bin", "IMU[2]", columns, "I", remarks)
