"""A field that is left out where it is zero."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.readers.formats import read_log
from rovid.trial.config import Config
from rovid.trial.trial import Trial
from tests.faults.drives import found
from tests.readers.logs import campaign, mcap_bytes, to_ns

TIME = 0.1 * np.arange(400)
STEPS = np.where(TIME % 8.0 < 3.0, 0.9, np.where(TIME % 8.0 < 6.0, 0.0, -0.9))
RNG = np.random.default_rng(1)
TOML = """
[[thrusters]]
name = "fore"
yaw_arm = 0.4
curve = "curve.csv"
command = { mcap = "/s.fore" }
[[thrusters]]
name = "aft"
yaw_arm = 0.4
curve = "curve.csv"
command = { mcap = "/s.aft" }
[signals]
heading = { mcap = "/s.heading" }
"""


def read(folder: Path, fore: list[Any], aft: list[Any]) -> Trial:
    """A log whose messages lack a command where it is "absent"."""
    config: Config = campaign(folder, TOML)
    heading = (np.cumsum(STEPS) + RNG.normal(0.0, 0.02, len(TIME))) % 360.0
    messages = []
    for ns, psi, *orders in zip(to_ns(TIME), heading, fore, aft, strict=True):
        fields = {"heading": float(psi)}
        fields |= {name: one for name, one in zip(("fore", "aft"), orders, strict=True) if one != "absent"}
        messages.append(("/s", int(ns), fields))
    path = folder / "run.mcap"
    path.write_bytes(mcap_bytes(messages))
    return read_log(path, config, path.name)


def without_zeros(values: FloatArray) -> list[Any]:
    return [value or "absent" for value in values.tolist()]


def test_zeros_are_taken(tmp_path: Path) -> None:
    trial = read(tmp_path, without_zeros(STEPS), STEPS.tolist())
    (fault,) = found(trial, "absent_zero")
    np.testing.assert_array_equal(trial.commands[:, 0], trial.commands[:, 1])
    assert fault.size == np.count_nonzero(STEPS == 0.0)
    assert fault.at == pytest.approx((3.0,))


def test_a_sine_and_a_thruster_that_rests(tmp_path: Path) -> None:
    sine = np.round(np.sin(TIME), 1)
    trial = read(tmp_path, without_zeros(sine), ["absent"] * len(TIME))
    np.testing.assert_array_equal(trial.commands[:, 0], sine)
    assert not trial.commands[:, 1].any()
    assert len(found(trial, "absent_zero")) == 2


def test_a_field_that_is_never_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="never holds the field 'aft'"):
        read(tmp_path, STEPS.tolist(), ["absent"] * len(TIME))


@pytest.mark.parametrize(
    "orders",
    [
        STEPS.tolist(),
        [one if at % 4 == 0 else "absent" for at, one in enumerate((STEPS + 2.0).tolist())],  # A lower rate.
        [one if kept else "absent" for one, kept in zip((STEPS + 2.0).tolist(), RNG.random(400) > 0.1, strict=True)],
        [one or None for one in STEPS.tolist()],  # Empty, and not absent.
    ],
)
def test_other_fields(orders: list[Any], tmp_path: Path) -> None:
    assert json.dumps(orders)
    assert not found(read(tmp_path, orders, STEPS.tolist()), "absent_zero")
