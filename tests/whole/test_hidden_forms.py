"""Forms of causes that a simulator of this file hides in the sample day are found, and nothing else."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rovid.core.array_types import FloatArray
from tests.conftest import SAMPLES, Rovid

DAY = SAMPLES / "rosub_tank"
LOGS = ("hold_01", "hold_03", "sine_40s_a", "sine_80s", "staircase", "aft_only", "fore_only")
INERTIA, QUADRATIC, LINEAR = 5057.0, 3532.0, 132.0
PARTS = 10


def simulated(table: pd.DataFrame, seed: int, lags: tuple[float, float], coupled: float) -> pd.DataFrame:
    """Heading and sway under the commands of ``table``: thrust grows and falls with ``lags`` in s.

    Sway has the mass of 2600 kg, a drag of 500 N s/m, a random force, and the mass ``coupled`` in kg m with yaw.
    """
    random = np.random.default_rng(seed)
    curve = pd.read_csv(DAY / "thrust_curve.csv")
    wanted = [np.interp(table[name], curve["command"], curve["thrust_N"]) for name in ("fore_V", "aft_V")]
    step = float(table["time_s"].diff().median()) / PARTS
    force = 300.0 * np.repeat(random.standard_normal(len(table) // 100 + 1), 100)[: len(table)]
    thrust, state = np.array([wanted[0][0], wanted[1][0]]), np.zeros(3)
    rows: list[FloatArray] = []
    mass = np.array([[INERTIA, coupled], [coupled, 2600.0]])
    for fore, aft, across in zip(*wanted, force, strict=True):
        rows.append(state.copy())
        for _ in range(PARTS):
            goal = np.array([fore, aft])
            lag = np.where(np.abs(goal) > np.abs(thrust), *lags)
            thrust = goal + (thrust - goal) * np.exp(-step / np.maximum(lag, 1e-9))
            _, rate, sway = state
            torque = 0.43 * thrust.sum() - QUADRATIC * abs(rate) * rate - LINEAR * rate
            state[1:] += step * np.linalg.solve(mass, [torque, across - 500.0 * sway])
            state[0] += step * state[1]
    angle, _, sway = np.transpose(rows)
    heading = np.degrees(angle) + random.normal(0.0, 0.01, len(angle))
    return table.assign(heading_deg=heading % 360.0, sway_m_s=sway + random.normal(0.0, 0.002, len(sway)))


@pytest.mark.slow
@pytest.mark.parametrize(("lags", "coupled", "form", "truth"), [
    ((0.4, 0.9), 0.0, "thruster_lag:unequal_thrust", {"time_constant": 0.4, "falling": 0.9}),
    ((0.0, 0.0), 1200.0, "sideslip_moment:acceleration", {"mass": 1200.0}),
])  # fmt: skip
def test_a_hidden_form_is_named_with_its_size(
    lags: tuple[float, float], coupled: float, form: str, truth: dict[str, float], tmp_path: Path, rovid: Rovid
) -> None:
    shutil.copy(DAY / "thrust_curve.csv", tmp_path)
    toml = (DAY / "rovid.toml").read_text()
    (tmp_path / "rovid.toml").write_text(toml + 'sway_velocity = { csv = "sway_m_s" }\n' * bool(coupled))
    for number, log in enumerate(LOGS):
        table = simulated(pd.read_csv(DAY / f"{log}.csv"), number, lags, coupled)
        table.to_csv(tmp_path / f"{log}.csv", index=False)
    document = rovid("diagnose", tmp_path, "--json").document
    assert [f"{one['effect']}:{one['form']}" for one in document["findings"]] == [form]
    for name, value in truth.items():
        found = document["findings"][0]["parameters"][name]
        # Four standard errors, and two percent for the steps of this simulator.
        assert abs(found["value"] - value) < 4.0 * found["standard_error"] + 0.02 * value
    inertia = document["extended"]["parameters"]["inertia"]
    assert abs(inertia["value"] - INERTIA) < 4.0 * inertia["standard_error"] + 0.02 * INERTIA
