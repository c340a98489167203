"""Inner loops: an ordered rate is told from a torque, and its lag from the logs; no inertia is made of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.estimate.inner_loop import find_inner_loop
from rovid.preflight.check import check_logs
from rovid.readers import read_campaign
from rovid.store.study import Study, open_study
from rovid.trial.config import load_config
from rovid.trial.preprocessing import prepare

PERIOD = 0.05  # s, between rows.
PARTS = 25  # Steps of the simulation in a row.
DECLARED = 'time = "t"\nheading = "psi"\nyaw_rate_order = { csv = "x", unit = "deg/s" }\n'
NAMED = (
    '[[thrusters]]\nname = "loop"\nyaw_arm = 1.0\ncurve = "curve.csv"\ncommand = "COLUMN"\n'
    '[signals]\ntime = "t"\nheading = "psi"\n'
)


def steps(rng: np.random.Generator, size: float, hold: float, count: int) -> FloatArray:
    return np.repeat(rng.uniform(-size, size, count), round(hold / PERIOD))


def late(values: FloatArray, lag: float, dead_time: float = 0.0) -> FloatArray:
    """(n + 1,) integral of ``values``, held over each row, after a lag of first order and a dead time in s."""
    fine = np.concatenate((np.zeros(round(dead_time * PARTS / PERIOD)), np.repeat(values, PARTS)))
    rate, angle, found = 0.0, 0.0, [0.0]
    decay = np.exp(-PERIOD / PARTS / lag)
    for number, value in enumerate(fine[: PARTS * len(values)].tolist(), start=1):
        change = (rate - value) * (1.0 - decay)
        angle += value * PERIOD / PARTS + change * lag
        rate -= change
        if number % PARTS == 0:
            found.append(angle)
    return np.array(found)


def write(folder: Path, toml: str, header: str, columns: Sequence[np.ndarray[Any, Any]]) -> None:
    (folder / "rovid.toml").write_text(toml)
    (folder / "curve.csv").write_text("command,thrust_N\n-400,-400\n400,400\n")
    np.savetxt(folder / "run.csv", np.column_stack(columns), fmt="%.6f", delimiter=",", header=header, comments="")


def write_loop(folder: Path, toml: str, column: str, gain: float, lag: float, dead_time: float, seed: int = 3) -> None:
    """A log of 200 s: ``column`` orders the rate in deg/s, heading noise 0.02 deg."""
    rng = np.random.default_rng(seed)
    order = steps(rng, 30.0, 12.0 * max(lag, 0.1), round(200.0 / (12.0 * max(lag, 0.1))))
    angle = gain * late(order, lag, dead_time)[:-1] + 0.02 * rng.standard_normal(len(order))
    write(folder, toml, f"t,psi,{column}", (PERIOD * np.arange(len(order)), angle, order))


@pytest.mark.parametrize(("gain", "lag", "dead_time"), [(1.0, 0.4, 0.0), (0.93, 1.5, 0.3), (-1.0, 0.8, 0.0)])
@pytest.mark.parametrize("seed", [1, 2])
def test_gain_and_lag_are_found(gain: float, lag: float, dead_time: float, seed: int, tmp_path: Path) -> None:
    write_loop(tmp_path, f"[signals]\n{DECLARED}", "x", gain, lag, dead_time, seed)
    config = load_config(tmp_path / "rovid.toml")
    found = find_inner_loop(prepare(read_campaign([tmp_path], config), config.vehicle).items, config)
    assert found is not None
    assert found.gain == pytest.approx(gain, abs=0.01 + 4.0 * found.gain_error)
    assert found.lag == pytest.approx(lag + dead_time, abs=0.005 + 4.0 * found.lag_error)  # 5 ms: a tenth of a row
    assert found.r2 > 0.8


@pytest.mark.parametrize(("toml", "column"), [(f"[signals]\n{DECLARED}", "x"), (NAMED, "yaw_rate_cmd")])
def test_no_inertia_is_made_of_an_inner_loop(toml: str, column: str, tmp_path: Path) -> None:
    write_loop(tmp_path, toml.replace("COLUMN", column), column, 1.0, 0.5, 0.0)
    with pytest.raises(DataError, match=r"order to a controller of the yaw rate, not a torque.*with a lag of 0\.[45]"):
        open_study([tmp_path])
    check = check_logs([tmp_path], load_config(tmp_path / "rovid.toml"))
    assert [(one.kind, check.verdict) for one in check.advice] == [("inner_loop", "no_go")]


def test_a_rate_that_does_not_follow_its_order_is_said(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    order = steps(rng, 10.0, 5.0, 20)
    angle = np.cumsum(rng.standard_normal(len(order)))
    write(tmp_path, f"[signals]\n{DECLARED}", "t,psi,x", (PERIOD * np.arange(len(order)), angle, order))
    with pytest.raises(DataError, match=r"R2 0\.0"):
        open_study([tmp_path])


@pytest.mark.parametrize("column", ["thruster_V", "speed_cmd"])
def test_a_command_of_another_size_or_name_is_no_inner_loop(column: str, tmp_path: Path) -> None:
    """A thruster's command: the rate is a fifth of it, or equal to it by chance under a name that says nothing."""
    gain = 0.2 if column == "speed_cmd" else 1.0
    write_loop(tmp_path, NAMED.replace("COLUMN", column), column, gain, 2.0, 0.0)
    assert isinstance(open_study([tmp_path]), Study)


def test_steered_wheels_set_a_rate(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    delta, speed = steps(rng, 0.3, 2.0, 60), np.abs(steps(rng, 2.0, 10.0, 12)) + 0.5
    heading = np.degrees(late(speed * np.tan(delta) / 0.33, 0.2)[:-1])
    toml = (
        '[[rudders]]\nangle = { csv = "delta", unit = "rad" }\nwheelbase = 0.33\nspeed = "v"\n'
        '[signals]\ntime = "t"\nheading = "psi"\nv = "V"\n'
    )
    write(tmp_path, toml, "t,psi,delta,V", (PERIOD * np.arange(len(delta)), heading, delta, speed))
    with pytest.raises(DataError, match=r"rudder_1 steers wheels.* is (0\.99|1\.00)\d* ± .* lag of 0\.(19|20)"):
        open_study([tmp_path])
