"""`rovid plan --axes planar`: a simulator of its own carries out the planned run, and the fit keeps the promise."""

from __future__ import annotations

import math
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.conftest import SAMPLES, Rovid

SAMPLE = SAMPLES / "planar_rov"
# The truth of the sample's README: inertias, drags, current, disturbance with its correlation time, and noise.
MASS = np.array([[146.3, 0.0, 0.0], [0.0, 155.4, 9.582], [0.0, 9.582, 11.54]])
LINEAR, QUADRATIC = np.array([34.39, 6.515, 3.823]), np.array([96.63, 161.9, 3.67])
CURRENT = 0.0826 * np.array([math.cos(2.5375), math.sin(2.5375)])
DISTURBANCE, MEMORY = np.array([0.30, 0.08, 0.026]), 2.0
HEADING_NOISE, SPEED_NOISE = 0.066, 0.0061
STEP = 0.02


def carry_out(commands: pd.DataFrame, log: Path, seed: int) -> None:
    """Write a log of the vehicle under ``commands``, with midpoint steps between the rows at 50 Hz."""
    rng = np.random.default_rng(seed)
    thrusters = tomllib.loads((SAMPLE / "rovid.toml").read_text())["thrusters"]
    time = STEP * np.arange(int(commands["time_s"].iloc[-1] / STEP) + 1)
    held = commands.iloc[np.searchsorted(commands["time_s"], time + 1e-9, side="right") - 1]
    force = np.zeros((len(time), 3))
    for one in thrusters:
        curve = pd.read_csv(SAMPLE / one["curve"])
        thrust = np.interp(held[one["name"]], curve["command"], curve["thrust_N"])
        force += thrust[:, None] * [one.get(key, 0.0) for key in ("surge", "sway", "yaw_arm")]
    keep, coloured = math.exp(-STEP / MEMORY), DISTURBANCE * rng.standard_normal(3)
    for at in range(len(time)):
        force[at] += coloured
        coloured = keep * coloured + math.sqrt(1.0 - keep**2) * DISTURBANCE * rng.standard_normal(3)

    def slope(state: np.ndarray, push: np.ndarray) -> np.ndarray:
        nu = state[1:]
        p = MASS @ nu
        coriolis = np.array([-p[1] * nu[2], p[0] * nu[2], p[1] * nu[0] - p[0] * nu[1]])
        return np.array([nu[2], *np.linalg.solve(MASS, push - coriolis - (LINEAR + QUADRATIC * np.abs(nu)) * nu)])

    states = np.zeros((len(time), 4))
    states[0, 0] = 1.0
    for k in range(1, len(time)):
        middle = states[k - 1] + 0.5 * STEP * slope(states[k - 1], force[k - 1])
        states[k] = states[k - 1] + STEP * slope(middle, force[k - 1])
    psi = states[:, 0]
    ahead = states[:, 1] + CURRENT[0] * np.cos(psi) + CURRENT[1] * np.sin(psi)
    across = states[:, 2] - CURRENT[0] * np.sin(psi) + CURRENT[1] * np.cos(psi)
    table = held.drop(columns="time_s").reset_index(drop=True)
    noise = rng.standard_normal((3, len(time)))
    number = np.arange(len(time))
    # The compass has readings at 16.7 Hz here and at 20 Hz in the logs at hand.
    table.insert(0, "v_m_s", np.where(number % 5 == 0, across + SPEED_NOISE * noise[0], np.nan))
    table.insert(0, "u_m_s", np.where(number % 5 == 0, ahead + SPEED_NOISE * noise[1], np.nan))
    table.insert(0, "heading_deg", np.where(number % 3 == 0, np.degrees(psi) % 360 + HEADING_NOISE * noise[2], np.nan))
    table.insert(0, "time", time)
    table.to_csv(log, index=False, float_format="%.5f")


@pytest.mark.slow
def test_the_planned_run_keeps_its_promise(rovid: Rovid) -> None:
    shutil.copytree(SAMPLE, "logs")
    model = ("logs", "--axes", "planar", "--effect", "current")
    document = rovid("plan", *model, "--json").document
    name = document["narrow"]
    promised = document["standard_errors"][name]
    assert promised["after"] < 0.8 * promised["before"]
    carry_out(pd.read_csv("plan.csv"), Path("logs/run_07.csv"), seed=5)
    found = rovid("fit", *model, "--json").document["parameters"][name]
    assert promised["after"] / 1.5 < found["standard_error"] < 1.5 * promised["after"]


@pytest.fixture
def few(tmp_path: Path) -> Path:
    """Two runs of the sample."""
    folder = shutil.copytree(SAMPLE, tmp_path / "few")
    for number in (2, 3, 4, 5):
        (folder / f"run_0{number}.csv").unlink()
    return folder


@pytest.mark.slow
def test_a_plan_keeps_the_limits(few: Path, rovid: Rovid) -> None:
    limits = ("--minutes", 1.5, "--share", 0.5, "--max-rate", 45, "--turns", 2)
    document = rovid("plan", few, "--axes", "planar", *limits, "--narrow", "yaw.linear_drag", "--json").document
    assert document["schema"] == "rovid-plan/1"
    assert (document["axes"], document["narrow"]) == ("planar", "yaw.linear_drag")
    reasons = {one["reason"] for one in document["left_out"]}
    assert {"longer than the limit", "beyond the limit of the yaw rate"} <= reasons
    assert all(run["seconds"] <= 90.1 for run in document["runs"])
    gains = [run["gain_per_minute"] for run in document["runs"]]
    assert gains == sorted(gains, reverse=True)
    pair = document["standard_errors"]["yaw.linear_drag"]
    assert math.log((pair["before"] / pair["after"]) ** 2) == pytest.approx(document["runs"][0]["gain"], rel=1e-3)
    planned = pd.read_csv("plan.csv")
    logged = pd.concat([pd.read_csv(log) for log in few.glob("run_*.csv")])
    for name in planned.columns[1:]:
        assert document["commands"][name] == pytest.approx(planned[name].tolist(), abs=1e-2)
        for most, sign in ((logged[name].max(), 1.0), (logged[name].min(), -1.0)):
            # The commands without thrust are about 1500.
            assert (sign * (planned[name] - 1500.0)).max() <= 0.5 * sign * (most - 1500.0) + 10.0, name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--narrow", "sway.linear"), "'sway.linear_drag'"),
        (("--minutes", 0.2), "no run stays within these limits"),
        (("--between", "current"), "--between: does not exist with --axes planar"),
        (("-o", "mine.csv"), "mine.csv"),
        (("--effect", "sideslip_moment"), "Munk"),
    ],
)
def test_a_mistake_gives_one_message(few: Path, rovid: Rovid, arguments: tuple[object, ...], said: str) -> None:
    Path("mine.csv").write_text("time_s,main\n0,1500\n")
    done = rovid("plan", few, "--axes", "planar", *arguments)
    assert done.code == 2
    assert said in done.err
    assert done.err.count("\n") == 1
    assert Path("mine.csv").read_text() == "time_s,main\n0,1500\n"
    assert not Path("plan.csv").exists()
