"""Effects put into a real log."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.conftest import SAMPLES
from tools.hidden import FORMS, Hidden
from tools.inject import INJECTABLE, Source, inject, linear_curve

DIVE = Source(folder=SAMPLES / "bluerov2_pier59")


def _table(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "dive.csv")


def _curve(folder: Path, number: int = 0) -> pd.DataFrame:
    configuration = tomllib.loads((folder / "rovid.toml").read_text(encoding="utf-8"))
    return pd.read_csv(folder / configuration["thrusters"][number]["curve"])


def test_nothing_injected_is_the_log_itself(tmp_path: Path) -> None:
    inject(DIVE, tmp_path, ())
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (DIVE.folder / path.name).read_bytes()


def test_commands_are_logged_earlier(tmp_path: Path) -> None:
    delay = Hidden(effect="command_delay", form="constant", parameters={"delay": 0.25})
    inject(DIVE, tmp_path, [delay])
    told, true = _table(tmp_path), _table(DIVE.folder)
    assert 0 < len(true) - len(told) < 10
    wanted = np.interp(told["t_s"] + 0.25, true["t_s"], true["pwm2_us"])
    np.testing.assert_allclose(told["pwm2_us"], wanted, atol=1e-5)
    pd.testing.assert_series_equal(told["heading_deg"], true["heading_deg"].loc[: len(told) - 1], check_exact=False)


def test_heading_deviates(tmp_path: Path) -> None:
    one = Hidden(effect="heading_deviation", form="two_cycles", parameters={"amplitude": 0.05, "phase": 0.3})
    inject(DIVE, tmp_path, [one])
    told, true = _table(tmp_path)["heading_deg"], _table(DIVE.folder)["heading_deg"]
    wanted = np.degrees(0.05) * np.sin(2.0 * np.radians(true) + 0.3)
    np.testing.assert_allclose((told - true + 180.0) % 360.0 - 180.0, wanted, atol=1e-5)


def test_curves_are_told_without_what_is_hidden(tmp_path: Path) -> None:
    true = _curve(DIVE.folder)
    offset = true["command"].to_numpy(np.float64) - 1500.0
    hidden = {
        "zone": Hidden(effect="thruster_deadband", form="shift", parameters={"deadband": 12.0}),
        "gain": Hidden(effect="thrust_asymmetry", form="gain", parameters={"reverse_gain": 0.8}),
        "shape": Hidden(effect="thrust_curve_shape", form="power", parameters={"exponent": 0.8, "thrust": 5.0}),
        "weak": Hidden(effect="thruster_imbalance", form="gain", thruster="thruster_3", parameters={"gain": 0.75}),
    }
    for name, one in hidden.items():
        inject(DIVE, tmp_path / name, [one])
    zone = _curve(tmp_path / "zone")["thrust_N"].to_numpy()
    back = np.sign(offset) * np.maximum(np.abs(offset) - 12.0, 0.0)
    inside = np.abs(offset) < 380.0  # beyond the table's end its last value holds
    again = np.interp(back, offset, zone)
    np.testing.assert_allclose(again[inside], true["thrust_N"][inside], atol=0.05)
    assert (zone[np.abs(offset) > 17.0] != 0.0).all()
    reverse = _curve(tmp_path / "gain")["thrust_N"] * np.where(offset < 0.0, 0.8, 1.0)
    np.testing.assert_allclose(reverse, true["thrust_N"], rtol=1e-6)
    shape = _curve(tmp_path / "shape")["thrust_N"]
    np.testing.assert_allclose(np.sign(shape) * 5.0 * (np.abs(shape) / 5.0) ** 0.8, true["thrust_N"], rtol=1e-6)
    np.testing.assert_allclose(0.75 * _curve(tmp_path / "weak", 2)["thrust_N"], true["thrust_N"], rtol=1e-6)
    np.testing.assert_allclose(_curve(tmp_path / "weak", 0)["thrust_N"], true["thrust_N"])


def test_linear_curve_and_what_cannot_be_injected(tmp_path: Path) -> None:
    linear_curve(DIVE, tmp_path)
    curve = _curve(tmp_path)
    assert np.ptp(np.diff(curve["thrust_N"]) / np.diff(curve["command"])) < 1e-5
    assert np.interp(1500.0, curve["command"], curve["thrust_N"]) == pytest.approx(0.0, abs=1e-6)
    assert all(form in FORMS[effect] for effect, form in INJECTABLE)
    bias = Hidden(effect="bias_torque", form="constant", parameters={"torque": 1.0})
    with pytest.raises(ValueError, match="acts through the motion"):
        inject(DIVE, tmp_path, [bias])
