"""Campaigns with causes of no catalogue."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tools.beyond import CAUSES, CRAFT, HELD_OUT, Now, write


def rates(folder: Path, cause: str) -> np.ndarray:
    write(folder, cause, 1)
    truth = json.loads((folder / "truth.json").read_text())
    assert len(truth["calm_rates"]) == HELD_OUT
    return np.concatenate([*truth["calm_rates"].values()])


def test_a_cause_changes_the_motion_and_nothing_else(tmp_path: Path) -> None:
    plain, hidden = rates(tmp_path / "plain", "nothing"), rates(tmp_path / "hidden", "magnus")
    assert 0.05 < np.std(hidden - plain) / np.std(plain) < 0.5
    for log in sorted((tmp_path / "plain" / "logs").glob("run_*.csv")):
        one, other = (pd.read_csv(tmp_path / which / "logs" / log.name) for which in ("plain", "hidden"))
        assert not one["heading_deg"].equals(other["heading_deg"])
        assert one.drop(columns="heading_deg").equals(other.drop(columns="heading_deg"))
    first, last = (pd.read_csv(tmp_path / "plain" / "logs" / f"run_0{k}.csv")["time_s"][0] for k in (1, 7))
    assert (last - first) / 86400.0 == pytest.approx(6.0, abs=0.1)


@pytest.mark.parametrize("cause", [name for name in CAUSES if name != "nothing"])
def test_each_law_acts_in_its_own_way(cause: str) -> None:
    now = Now(craft=CRAFT[0], step=0.02, day=3.0, rate=0.2, acceleration=0.05, thrust=(90.0, 90.0))
    now.signal = {"roll": 0.06, "surge_velocity": 0.4, "sway_velocity": 0.2, "water_temperature": 7.0}
    for _ in range(100):
        torque = CAUSES[cause].law(now)
    assert abs(torque) > 0.01 * CRAFT[0].torque or abs(now.bend) > 0.01
