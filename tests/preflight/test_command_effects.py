"""Effects of commands on the motion; reversed and ineffective thrusters of rovid.toml."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from rovid.preflight.check import reversed_thrusters
from rovid.preflight.command_effects import all_reversed, check_thrusters, command_effects
from rovid.preflight.raw_columns import RawColumn, SignalGuess
from rovid.store.study import open_study
from rovid.trial.axis import YAW
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tests.conftest import SAMPLES, Rovid
from tools.wide import draw, write_campaign

CURVE = ThrustCurve(command=np.array([-1.0, 1.0]), thrust=np.array([-100.0, 100.0]))


def steered(seed: int, *, hand: bool) -> dict[str, RawColumn]:
    """A slow vehicle in eddies under an autopilot with a noisy compass, or under open-loop commands (``hand``)."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 240.0, 0.1)
    heading, command = np.empty(len(time)), np.empty(len(time))
    asked = np.repeat(rng.uniform(-0.7, 0.7, 40), 60)
    place = rate = thrust = eddy = 0.0
    for k in range(len(time)):
        heading[k] = place + np.radians(0.3) * rng.normal()
        command[k] = asked[k] if hand else np.clip(-1.2 * heading[k] - 6.0 * rate, -0.7, 0.7)
        for _ in range(4):
            thrust += 0.0625 * (command[k] - thrust)
            eddy += -0.0125 * eddy + 0.0012 * rng.normal()
            rate += 0.025 * (0.075 * thrust + eddy - 0.58 * abs(rate) * rate - 0.075 * rate)
            place += 0.025 * rate
    return {
        "heading_deg": RawColumn(source="heading_deg", time=time, values=np.degrees(heading)),
        "yaw_cmd": RawColumn(source="yaw_cmd", time=time, values=command),
    }


@pytest.mark.parametrize("hand", [True, False])
def test_feedback_does_not_reverse_a_direction(hand: bool) -> None:
    heading = SignalGuess(source="heading_deg", reason="", unit="deg")
    found = [command_effects({"yaw_cmd": 0.0}, [steered(seed, hand=hand)], heading)["yaw_cmd"] for seed in range(6)]
    ways = [one.direction for one in found]
    assert ways.count(-1) <= (0 if hand else 2), found
    assert ways.count(1) >= 5 * hand


def test_the_explained_share_is_that_of_the_acting_command() -> None:
    logs = [steered(1, hand=True)]
    heading = SignalGuess(source="heading_deg", reason="", unit="deg")
    levels = np.repeat(np.random.default_rng(5).uniform(-1.0, 1.0, 40), 60)
    idle = RawColumn(source="idle", time=logs[0]["yaw_cmd"].time, values=levels)
    found = command_effects({"yaw_cmd": 0.0, "idle": 0.0}, [logs[0] | {"idle": idle}], heading)
    assert found["yaw_cmd"].direction == 1
    assert found["idle"].direction == 0
    assert found["yaw_cmd"].explained_share > 10.0 * abs(found["idle"].explained_share)
    assert "standard errors" in found["yaw_cmd"].text


def trial(arms: tuple[float, ...], seed: int = 3) -> Trial:
    """A vehicle of 200 kg m^2 under independent commands, with true ``arms``."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 240.0, 0.1)
    commands = np.column_stack([np.repeat(rng.uniform(-1.0, 1.0, 80), 30) for _ in arms])
    rate, angle, angles = 0.0, 0.0, np.empty(len(time))
    for k, torque in enumerate(commands @ (100.0 * np.array(arms))):
        angles[k] = angle
        rate += 0.1 * (torque + rng.normal(0.0, 5.0) - 120.0 * rate) / 200.0
        angle += 0.1 * rate
    return Trial(name="a", path=Path("a"), time=time, position=angles + rng.normal(0.0, 1e-4, 2400), commands=commands)


def vehicle(*arms: float) -> Vehicle:
    return Vehicle(name="", thrusters=tuple(Thruster(name=f"t{k}", arm=arm, curve=CURVE) for k, arm in enumerate(arms)))


def test_correct_thrusters_are_not_reported() -> None:
    found = check_thrusters([trial((0.4, -0.4, 0.3))], vehicle(0.4, -0.4, 0.3))
    assert [push.observed.direction for push in found] == [1, 1, 1]
    assert not [push for push in found if push.is_reversed or push.is_ineffective]
    assert sum(push.observed.explained_share for push in found) == pytest.approx(1.0, abs=0.3)
    assert all(abs(push.strength - 1.0) < 0.15 for push in found)


def test_reversed_and_ineffective_thrusters_are_found() -> None:
    found = check_thrusters([trial((0.4, -0.4, 0.0))], vehicle(0.4, 0.4, 0.4))
    assert [push.is_reversed for push in found] == [False, True, False]
    assert [push.is_ineffective for push in found] == [False, False, True]


def test_a_weak_thruster_that_always_pushes_with_another_is_not_reversed() -> None:
    """Two screws driven against each other: reverse thrust is a third, and the second screw pushes half."""
    rng = np.random.default_rng(6)
    together = np.repeat(rng.uniform(-1.0, 1.0, 400), 30)
    time, command = 0.1 * np.arange(float(len(together))), np.column_stack((together, -together))
    thrust = np.where(command > 0.0, 100.0 * command, 35.0 * command) @ [0.4, -0.2]
    rate = lfilter([0.1 / 60.0], [1.0, -(1.0 - 0.1 * 60.0 / 60.0)], thrust + rng.normal(0.0, 2.0, len(time)))
    position = 0.1 * np.cumsum(rate) + rng.normal(0.0, 1e-3, len(time))
    bench = ThrustCurve(command=np.array([-1.0, 0.0, 1.0]), thrust=np.array([-80.0, 0.0, 100.0]))
    pair = Vehicle(name="", thrusters=tuple(Thruster(name=f"{arm}", arm=arm, curve=bench) for arm in (0.4, -0.4)))
    log = Trial(name="a", path=Path("a"), time=time, position=position, commands=command)
    assert [push.observed.direction for push in check_thrusters([log], pair)] == [1, 0]


def test_a_heading_of_the_other_sign_is_one_advice() -> None:
    found = check_thrusters([trial((0.4, -0.4, 0.3))], vehicle(-0.4, 0.4, -0.3))
    assert "sign = -1" in all_reversed(found, YAW)
    found = check_thrusters([trial((0.4, -0.4, 0.3))], vehicle(-0.4, 0.4, 0.3))
    assert [push.is_reversed for push in found] == [True, True, False]
    assert not all_reversed(found, YAW)


def test_one_odd_log_turns_no_arm_around() -> None:
    """Three move together. In one log of four the first, four times as strong, runs alone; then none pushes."""
    arms = np.array([0.4, -0.4, 0.3])
    trials = []
    for seed in range(4):
        rng, time = np.random.default_rng(seed), np.arange(0.0, 240.0, 0.1)
        commands = np.outer(np.repeat(rng.uniform(-1.0, 1.0, 80), 30), [1.0, -1.0, 0.8])
        torque = commands @ (100.0 * arms)
        if seed == 3:
            torque[1200:] = 0.0
            commands[:1200, 1:] = 0.0
            torque[:1200] = 160.0 * commands[:1200, 0]
        rate = lfilter([0.1 / 200.0], [1.0, -(1.0 - 0.1 * 120.0 / 200.0)], torque + rng.normal(0.0, 5.0, 2400))
        angle = 0.1 * np.cumsum(rate)
        trials.append(Trial(name="a", path=Path("a"), time=time, position=angle, commands=commands))
    assert not [push.name for push in check_thrusters(trials, vehicle(*arms)) if push.is_reversed]
    contradicted = [push.observed.is_contradicted for push in check_thrusters(trials, vehicle(*arms))]
    assert contradicted == [False, True, True]


@pytest.mark.parametrize("faded", [True, False])
def test_thrust_that_fades_turns_no_arm_around(faded: bool) -> None:
    """Three move together, but the first rests in two logs, and the third in one. Thrust fades, or one is reversed."""
    arms, trials = np.array([0.4, -0.4, 0.3]), []
    for at in range(6):
        rng, time = np.random.default_rng(at), np.arange(0.0, 240.0, 0.1)
        commands = np.outer(np.repeat(rng.uniform(-1.0, 1.0, 80), 30), [float(at > 1), -1.0, 0.8 * (at != 1)])
        torque = commands @ (100.0 * arms * [1.0 if faded else -1.0, 1.0, 1.0])
        torque *= 1.0 - (0.46 + 0.04 * at if faded and at > 1 else 0.0)
        rate = lfilter([0.1 / 200.0], [1.0, -(1.0 - 0.1 * 120.0 / 200.0)], torque + rng.normal(0.0, 5.0, 2400))
        trials.append(Trial(name="a", path=Path("a"), time=time, position=0.1 * np.cumsum(rate), commands=commands))
    found = check_thrusters(trials, vehicle(*arms))
    assert [push.is_reversed for push in found] == [not faded, False, False]


def collinear_trial(seed: int) -> Trial:
    """A slow vehicle with quadratic drag in eddies with a memory of 15 s; its three thrusters move almost together."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 300.0, 0.1)
    together = np.repeat(rng.uniform(-1.0, 1.0, 12), 250)
    own = np.column_stack([np.repeat(rng.uniform(-0.3, 0.3, 12), 250) for _ in range(3)])
    commands = np.clip(together[:, None] * [1.0, -1.0, 0.8] + own, -1.0, 1.0)
    rate, angle, eddy, angles = 0.0, 0.0, 0.0, np.empty(len(time))
    for k, torque in enumerate(commands @ (100.0 * np.array([0.4, -0.4, 0.3]))):
        angles[k] = angle
        eddy += -eddy * 0.1 / 15.0 + rng.normal(0.0, 0.5 * np.sqrt(0.2 / 15.0))
        rate += 0.1 * (torque + eddy - 200.0 * abs(rate) * rate - 30.0 * rate) / 1500.0
        angle += 0.1 * rate
    return Trial(name="a", path=Path("a"), time=time, position=angles + rng.normal(0.0, 1e-4, 3000), commands=commands)


@pytest.mark.parametrize("seed", range(8))
def test_thrusters_that_move_almost_together_are_reversed_only_where_one_is(seed: int) -> None:
    trials, arms = [collinear_trial(seed)], [0.4, -0.4, 0.3]
    assert not [push.name for push in check_thrusters(trials, vehicle(*arms)) if push.is_reversed]
    for turned in range(3):
        signs = [-1.0 if at == turned else 1.0 for at in range(3)]
        found = check_thrusters(trials, vehicle(*(arm * sign for arm, sign in zip(arms, signs, strict=True))))
        assert [push.is_reversed for push in found] == [at == turned for at in range(3)]


@pytest.mark.parametrize("exponent", [1.0, 2.0])
@pytest.mark.parametrize("arms", [(0.4, 0.4), (-0.4, 0.3)])
@pytest.mark.parametrize("seed", range(4))
def test_a_thrust_that_is_curved_in_the_command_leaves_no_doubt_about_directions(
    exponent: float, arms: tuple[float, float], seed: int
) -> None:
    """Both thrusters together, then each alone, both ways."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 900.0, 0.1)
    levels = np.repeat(rng.uniform(0.3, 1.0, 18) * np.tile([1.0, -1.0], 9), 500)
    alone = np.repeat([0] * 16 + [1, 2], 500)
    commands = np.column_stack([np.where(alone == other, 0.0, levels) for other in (2, 1)])
    rate, angle, angles = 0.0, 0.0, np.empty(len(time))
    for k, torque in enumerate(np.sign(commands) * np.abs(commands) ** exponent @ (100.0 * np.array(arms))):
        angles[k] = angle
        rate += 0.1 * (torque + rng.normal(0.0, 1.0) - 300.0 * abs(rate) * rate - 30.0 * rate) / 1500.0
        angle += 0.1 * rate
    columns = {"angle": angles + rng.normal(0.0, 1e-4, len(time)), "fore": commands[:, 0], "aft": commands[:, 1]}
    log = {name: RawColumn(source=name, time=time, values=values) for name, values in columns.items()}
    found = command_effects({"fore": 0.0, "aft": 0.0}, [log], SignalGuess(source="angle", reason="", unit="rad"))
    assert [found[name].direction for name in ("fore", "aft")] == np.sign(arms).tolist()


def write_day(sample: str, folder: Path, arm: str, count: int = -1) -> None:
    """A copy of a sample campaign with ``arm`` in place of the first ``count`` arms."""
    shutil.copytree(SAMPLES / sample, folder)
    config = folder / "rovid.toml"
    text = config.read_text(encoding="utf-8")
    config.write_text(text.replace("yaw_arm = 0.43", f"yaw_arm = {arm}", count), encoding="utf-8")


@pytest.mark.slow
def test_check_reports_a_reversed_thruster(tmp_path: Path, rovid: Rovid) -> None:
    write_day("rosub_tank", tmp_path / "day", "-0.43", 1)
    document = rovid("check", "day", "--json").document
    assert document["verdict"] == "no_go"
    assert any(one["kind"] == "thruster" and "Turn yaw_arm of fore around" in one["text"] for one in document["advice"])
    assert {one["name"]: one["way"] for one in document["thrusters"]} == {"fore": -1, "aft": 1}
    assert "the other way" in rovid("check", "day").out


@pytest.mark.slow
def test_implausible_arms_are_reported(tmp_path: Path, rovid: Rovid) -> None:
    write_day("rosub_hidden", tmp_path / "day", "43.0")
    (fault,) = rovid("check", "day", "--json").document["faults"]
    assert (fault["fault"], fault["stops"]) == ("thrust_unit", True)
    write_day("rosub_hidden", tmp_path / "weak", "0.1")
    advice = rovid("check", "weak", "--json").document["advice"]
    assert any(one["kind"] == "thrust_scale" and "rovid fit-thrust-scale" in one["text"] for one in advice)
    advice = rovid("check", SAMPLES / "rosub_hidden", "--json").document["advice"]
    assert not [one for one in advice if "scale" in one["kind"]]


@pytest.mark.slow
def test_a_command_that_is_only_rounding_has_no_effect(tmp_path: Path) -> None:
    """Six thrusters of a drawn vehicle, three of which act as the others do."""
    write_campaign(tmp_path / "day", draw(113, 12, None))
    assert not reversed_thrusters(open_study([tmp_path / "day"]))


@pytest.mark.slow
def test_more_drag_to_one_side_reverses_no_thruster(tmp_path: Path) -> None:
    """Four thrusters of a drawn vehicle with 2.2 times the drag to port; two curves differ from the others by side."""
    write_campaign(tmp_path / "day", draw(95201, 31, None))
    assert not reversed_thrusters(open_study([tmp_path / "day"]))
