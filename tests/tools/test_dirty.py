"""Dirty logs: one draw for one seed, every fault and every format, the equation of motion, and the damage as stated."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tools.dirty import FAULTS, FORMATS, HIDDEN, Campaign, Log, draw_folder, write_folder
from tools.dirty.vehicle import FloatArray, Vehicle, draw_vehicle, move

SEED = 11


def drawn(fault: str | None, form: str | None = None, number: int = 0) -> tuple[Campaign, dict[str, Any], list[Log]]:
    """A damaged campaign, its truth, and its damaged logs."""
    campaign, truth = draw_folder(SEED, number, fault, None, form)
    runs = {name.split(".")[0].removesuffix("_nav") for name in truth["logs"]}
    return campaign, truth, [log for log in campaign.logs if log.name in runs]


def turned(degrees: FloatArray) -> FloatArray:
    """Angles in -180 to 180 deg."""
    return (degrees + 180.0) % 360.0 - 180.0


def error(log: Log) -> FloatArray:
    """Logged minus true heading, (n,) in deg."""
    true = np.interp(log.motion.instants, log.truth["time"], np.degrees(log.truth["heading"]))
    return turned(log.motion.columns["heading"] - true)


def test_the_same_seed_gives_the_same_files(tmp_path: Path) -> None:
    truths = [write_folder(tmp_path / name, SEED, 3) for name in ("a", "b")]
    assert truths[0] == truths[1]
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert files == sorted(path.name for path in (tmp_path / "b").iterdir())
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    assert draw_folder(SEED, 4)[1] != truths[0]


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_is_written(fault: str, tmp_path: Path) -> None:
    truth = write_folder(tmp_path, SEED, 1, fault)
    assert truth["fault"] == fault
    assert set(truth["logs"]) <= set(truth["runs"])
    assert all((tmp_path / name).stat().st_size > 1000 for name in truth["runs"])
    assert (tmp_path / "rovid.toml").exists()
    json.dumps(truth, allow_nan=False)


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_is_read_back(form: str, tmp_path: Path) -> None:
    from rovid.readers import read_campaign
    from rovid.trial.config import load_config

    campaign, truth = draw_folder(SEED, 2, None, None, form)
    write_folder(tmp_path, SEED, 2, None, None, form)
    trials = read_campaign([tmp_path], load_config(tmp_path / "rovid.toml")).trials
    assert [trial.name for trial in trials] == list(truth["runs"])
    for trial, log in zip(trials, campaign.logs, strict=True):
        heading = np.degrees(trial.position[trial.measured])
        assert len(heading) >= len(log.truth["time"]) - 2
        assert np.ptp(heading) == pytest.approx(np.ptp(np.degrees(log.truth["heading"])), abs=10.0 * campaign.noise)


@pytest.mark.parametrize("hidden", [None, *HIDDEN])
def test_runs_follow_the_equation_of_motion(hidden: str | None) -> None:
    campaign, _ = draw_folder(SEED, 5, None, hidden, "csv")
    vehicle, log = campaign.vehicle, campaign.logs[0]
    count = 60  # readings; the reference integrates every interval by itself
    first = int(np.argmax(np.abs(log.truth["torque"]) > 0.0))
    part = slice(first, first + count)
    time, torque = log.truth["time"][part], log.truth["torque"][part]
    extra = log.truth["disturbance"][part] + vehicle.bias
    state = np.array([log.truth["heading"][first], log.truth["rate"][first], 0.0])
    for k in range(count - 1):

        def slope(_: float, y: FloatArray, k: int = k) -> list[float]:
            drive = y[2] if vehicle.lag else torque[k]
            drag = vehicle.quadratic_drag * abs(y[1]) * y[1] + vehicle.linear_drag * y[1]
            lag = (torque[k] - y[2]) / vehicle.lag if vehicle.lag else 0.0
            return [y[1], (drive + extra[k] - drag) / vehicle.inertia, lag]

        state = solve_ivp(slope, (time[k], time[k + 1]), state, rtol=1e-9, atol=1e-12).y[:, -1]
    # The tolerance is that of RK4 at steps of a twentieth of the time constant.
    assert state[1] == pytest.approx(log.truth["rate"][part][-1], abs=1e-5 * vehicle.full_rate)
    assert state[0] == pytest.approx(
        log.truth["heading"][part][-1], abs=1e-5 * vehicle.full_rate * (time[-1] - time[0])
    )


def test_full_torque_gives_the_full_rate() -> None:
    vehicle = draw_vehicle(np.random.default_rng(SEED), "V")
    command = np.array([[10.0 * np.sign(thruster.arm) for thruster in vehicle.thrusters]])
    vehicle = replace(vehicle, thrusters=tuple(_symmetric(vehicle)))
    time = np.linspace(0.0, 20.0 * vehicle.time_constant, 200)
    _, rate = move(vehicle, time, np.zeros(1), command, np.zeros(200))
    assert rate[-1] == pytest.approx(vehicle.full_rate, rel=1e-4)


def _symmetric(vehicle: Vehicle) -> list[Any]:
    return [
        replace(one, thrust=np.sign(one.thrust) * np.maximum(np.abs(one.thrust), np.abs(one.thrust[::-1])))
        for one in vehicle.thrusters
    ]


def test_undamaged_logs_differ_from_the_truth_by_noise_alone() -> None:
    campaign, truth, _ = drawn(None)
    assert truth["fault"] is None
    for log in campaign.logs:
        assert np.std(error(log)) == pytest.approx(campaign.noise, rel=0.25)
        np.testing.assert_array_equal(log.motion.stamps, log.truth["time"])


def test_lost_rows() -> None:
    campaign, truth, logs = drawn("lost_rows", "csv")
    kept, whole = sum(len(log.motion.stamps) for log in logs), sum(len(log.truth["time"]) for log in logs)
    assert 1.0 - kept / whole == pytest.approx(truth["size"])
    assert all(len(log.motion.stamps) == len(log.truth["time"]) for log in campaign.logs if log not in logs)


@pytest.mark.parametrize("number", range(4))
def test_clock_step(number: int) -> None:
    _, truth, logs = drawn("clock_step", number=number)
    for log, at in zip(logs, truth["at"], strict=True):
        late = log.motion.stamps - log.motion.instants
        after = log.motion.instants - log.start >= at - 1e-9
        np.testing.assert_allclose(late[after], truth["size"], atol=1e-9)
        np.testing.assert_allclose(late[~after], 0.0, atol=1e-9)


@pytest.mark.parametrize("number", range(4))
def test_wild_stamp(number: int) -> None:
    _, truth, (log,) = drawn("wild_stamp", number=number)
    wild = np.abs(log.motion.stamps - log.motion.instants) > 100.0
    np.testing.assert_allclose(log.motion.instants[wild] - log.start, truth["at"], atol=1e-6)


def test_repeated_stamps_and_bursts() -> None:
    for number in range(4):
        _, truth, logs = drawn("repeated_stamps", number=number)
        equal = sum(np.count_nonzero(np.diff(log.motion.stamps) == 0.0) for log in logs)
        assert equal / sum(len(log.motion.stamps) for log in logs) == pytest.approx(truth["size"])
    _, truth, logs = drawn("arrival_bursts")
    steps = np.diff(logs[0].motion.stamps)
    assert np.count_nonzero(steps < 0.0025) / len(steps) == pytest.approx(1.0 - 1.0 / truth["size"], abs=0.02)


def test_clocks_apart_moves_the_commands_alone() -> None:
    campaign, truth, _ = drawn("clocks_apart")
    for log in campaign.logs:
        np.testing.assert_array_equal(log.motion.stamps, log.truth["time"])
        assert log.thrust.stamps[0] - log.thrust.instants[0] == pytest.approx(truth["size"])


@pytest.mark.parametrize("number", range(4))
def test_heading_step(number: int) -> None:
    campaign, truth, logs = drawn("heading_step", number=number)
    for log, at in zip(logs, truth["at"], strict=True):
        after = log.motion.instants - log.start >= at - 1e-9
        assert np.max(np.abs(turned(error(log) - truth["size"] * after))) < 6.0 * campaign.noise


def test_heading_gaps_and_silent_commands() -> None:
    _, truth, logs = drawn("heading_gaps", "csv")
    absent = np.concatenate([np.isnan(log.motion.columns["heading"]) for log in logs])
    assert absent.mean() == pytest.approx(truth["size"])
    _, truth, (log,) = drawn("stale_commands", "json")
    lost = np.setdiff1d(log.truth["command_time"], log.thrust.instants)
    assert np.ptp(lost) == pytest.approx(truth["size"])
    assert 0.0 < lost[0] - log.start - truth["at"][0] < 1.5 / truth["command_hz"]


def test_absent_zero_and_sentinels(tmp_path: Path) -> None:
    from mcap.reader import make_reader

    write_folder(tmp_path, SEED, 0, "absent_zero")
    with next(tmp_path.glob("*.mcap")).open("rb") as file:
        values = [
            v
            for _, _, message in make_reader(file).iter_messages("/thrusters")
            for v in json.loads(message.data).values()
        ]
    assert values
    assert 0.0 not in values
    campaign, truth, logs = drawn("sentinel_command", "bin")
    assert len(logs) == len(campaign.logs)
    for log in logs:
        commands = np.column_stack([*log.thrust.columns.values()])
        marked = (commands == truth["size"]).all(axis=1)
        assert marked.any()
        assert not log.truth["torque"][marked].any()
        assert not (commands == 1500.0).all(axis=1).any()


def test_units() -> None:
    campaign, truth, _ = drawn("thrust_unit")
    for thruster, (_, thrust) in zip(campaign.vehicle.thrusters, campaign.curves, strict=True):
        np.testing.assert_allclose(thrust * truth["size"], thruster.thrust)
    campaign, truth, _ = drawn("unit_mismatch")
    for thruster, (command, _) in zip(campaign.vehicle.thrusters, campaign.curves, strict=True):
        assert np.ptp(thruster.command) / np.ptp(command) == pytest.approx(truth["size"])


@pytest.mark.parametrize("number", range(3))
def test_clipped_and_scaled_headings(number: int) -> None:
    _, truth, logs = drawn("saturated_sensor", number=number)
    column = truth["note"]
    assert logs
    assert max(np.abs(log.motion.columns[column]).max() for log in logs) == pytest.approx(truth["size"])
    campaign, truth, _ = drawn("scaled_heading", number=number)
    log = campaign.logs[0]
    scale = np.degrees(1.0) if campaign.heading_unit == "rad" else 1.0
    true = np.degrees(log.truth["heading"]) * truth["size"] / scale
    full = 360.0 * truth["size"] / scale
    difference = (log.motion.columns["heading"] - true + full / 2.0) % full - full / 2.0
    assert np.max(np.abs(difference)) < 6.0 * campaign.noise * truth["size"] / scale


def test_runs_that_do_not_belong() -> None:
    campaign, _, logs = drawn("no_response")
    assert (
        np.std(turned(logs[0].motion.columns["heading"] - logs[0].motion.columns["heading"][0])) < 2.0 * campaign.noise
    )
    assert np.ptp(logs[0].truth["torque"]) > 0.4 * campaign.vehicle.full_torque
    for number in range(3):
        campaign, truth, logs = drawn("foreign_log", number=number)
        assert 0 < len(logs) < len(campaign.logs)
        campaign, truth, logs = drawn("same_run_twice", number=number)
        assert len(logs) == 2
        shared = np.intersect1d(logs[0].motion.instants, logs[1].motion.instants)
        whole = len(logs[0].truth["time"])
        assert len(shared) / whole == pytest.approx(truth["size"], abs=0.02)


def test_two_sources() -> None:
    campaign, truth, logs = drawn("two_sources")
    second = np.abs(turned(error(logs[0]) - truth["size"])) < 6.0 * campaign.noise
    first = np.abs(error(logs[0])) < 6.0 * campaign.noise
    assert np.all(first ^ second)
    assert second.mean() > 0.15


def test_several_tests_and_rest() -> None:
    campaign, truth, (log,) = drawn("several_releases")
    assert len(truth["at"]) == truth["size"] - 1
    assert np.max(np.abs(log.truth["disturbance"])) > 0.3 * campaign.vehicle.full_torque
    _, truth, (log,) = drawn("idle_ends")
    assert np.mean(log.truth["torque"] == 0.0) * log.truth["time"][-1] > 0.9 * truth["size"]
