"""Logs of another vehicle, logs of two payloads, and days of one vehicle, which give nothing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import played, slewed
from rovid.faults import no_response
from rovid.faults.base import RunsData, examine
from rovid.faults.foreign_log import (
    DETECTORS,
    _explains_itself,
    _foreign,
    _is_foreign,
    _with_own_model,
    minority_payload,
)
from rovid.faults.quick_model import fit_quick_model, log_name
from rovid.model.model import Model
from rovid.store.study import open_study
from rovid.trial.fault import Fault, FaultOverrides
from rovid.trial.preprocessing import Run, prepare_trials
from rovid.trial.vehicle import Thruster, Vehicle
from tests.conftest import slow
from tests.faults.days import SMALL, VEHICLES, day, programme, scaled
from tests.synthetic import LOGGED, VOLTS, clock, gauss_markov, run
from tools.dirty import write_folder

ARMS = {"a": 0.4, "b": -0.55}  # m
TWO = Vehicle(name="two", thrusters=tuple(Thruster(name=name, arm=arm, curve=VOLTS) for name, arm in ARMS.items()))
# Damage of one log: commands as logged, and as they act, from (n, 2) commands as ordered; and the clause that names it.
DAMAGES: dict[str, tuple[Callable[[FloatArray], FloatArray], Callable[[FloatArray], FloatArray]]] = {
    "the commands of a and b are exchanged": (lambda u: u[:, ::-1], lambda u: u),
    "the commands of a have the opposite sign": (lambda u: u * [-1.0, 1.0], lambda u: u),
    "the heading or all commands have the opposite sign": (lambda u: -u, lambda u: u),
    "the command of a is constant, in this log alone": (lambda u: u * [0.0, 1.0], lambda u: u),
    "the commands of a and b are equal, in this log alone": (lambda u: u[:, [0, 0]], lambda u: u),
    "a does not push.": (lambda u: u, lambda u: u * [0.0, 1.0]),
    "a does not push from 4": (
        lambda u: u,
        lambda u: np.where((np.arange(len(u)) < len(u) // 2)[:, None], u, u * [0.0, 1.0]),
    ),
    "": (lambda u: u, lambda u: u),
}


def two_thrusters(damage: str, seed: int, damaged: Collection[int] = (2,), turning: float = 0.0) -> list[Run]:
    """Six logs of 80 s at 5 Hz with steps of both thrusters; those with the ``damaged`` numbers are damaged.

    ``turning``: command to starboard for 30 s, and to port for 30 s.
    """
    rng, time, runs = np.random.default_rng(seed), clock(80.0, 5.0), []
    for number in range(6):
        ordered = rng.uniform(-1.0, 1.0, (40, 2))[(time // 4.0).astype(int)]
        ordered += turning * np.select([time < 30.0, time < 60.0], [1.0, -1.0])[:, None] * np.sign([*ARMS.values()])
        logged, acts = (each(ordered) for each in DAMAGES[damage if number in damaged else ""])
        torque, pushed = (100.0 * commands @ np.array([*ARMS.values()]) for commands in (logged, acts))
        disturbance = gauss_markov(len(time), 0.2, 2.0, 4.0, rng)
        noise = rng.normal(0.0, 1e-3, len(time))
        one = run(time, pushed, scaled(SMALL, 40.0, 40.0), cutoff=0.7, disturbance=disturbance, noise=noise)
        trial = replace(one.trial, name=f"run_{number}.csv", commands=logged)
        runs.append(replace(one, trial=trial, torque=torque, filtered_torque=one.rates.filter_held(trial, torque)))
    return runs


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_log_with_other_commands_than_its_thrusters_is_named(damage: str) -> None:
    for seed in range(2):
        data, faults = examine(
            DETECTORS["runs"], RunsData(runs=two_thrusters(damage, seed), vehicle=TWO), FaultOverrides()
        )
        assert [fault.logs for fault in faults] == ([("run_2.csv",)] if damage else [])
        assert len(data.runs) == 6 - bool(damage)
        assert all(damage in fault.text for fault in faults)


def test_a_coupled_vehicle_that_turns_by_itself_has_no_dead_thruster() -> None:
    """A hull that moves ahead is unstable (Munk moment); in yaw alone a thruster seems to stop."""
    damage = next(one for one in DAMAGES if "does not push" in one)
    data = RunsData(runs=two_thrusters(damage, 1), vehicle=replace(TWO, planar=True))
    assert not any("does not push" in fault.text for fault in examine(DETECTORS["runs"], data, FaultOverrides())[1])


@pytest.mark.parametrize(("low", "seed"), [(0.1, 4), (0.15, 2), (0.2, 7)])
def test_slow_turns_in_rough_water_and_a_fast_one_are_of_one_vehicle(low: float, seed: int) -> None:
    """Slow turns do not tell the quadratic from the linear drag, and a disturbance is as large as their thrust."""
    rng, time, runs = np.random.default_rng(seed), clock(30.0, 10.0), list[Run]()
    for number, level in enumerate((low, -low, -0.8)):
        commands = level * np.sign([*ARMS.values()]) * (time > 3.0)[:, None]
        torque, noise = 100.0 * commands @ np.array([*ARMS.values()]), rng.normal(0.0, 1e-3, len(time))
        disturbance = gauss_markov(len(time), 0.1, 2.0, 0.4, rng)
        one = run(time, torque, scaled(SMALL, 10.0, 10.0), cutoff=0.7, disturbance=disturbance, noise=noise)
        runs.append(replace(one, trial=replace(one.trial, name=f"hold_{number}.csv", commands=commands)))
    assert not examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=TWO), FaultOverrides())[1]


@pytest.mark.parametrize("is_dead", [True, False])
def test_a_thruster_that_pushes_in_no_log_is_no_fault_of_two_logs(is_dead: bool) -> None:
    """Used alone it moves nothing, and the other one alone turns the vehicle twice as well: one cause of all logs."""
    rng, time, runs = np.random.default_rng(5), clock(120.0, 5.0), list[Run]()
    signs, neutral = np.sign([*ARMS.values()]), np.zeros(2)
    for number, used in enumerate([signs, signs, signs, signs, [1.0, 0.0], [0.0, 1.0]]):
        level = (-0.9, 0.7, -0.5, 0.9, 0.8, -0.8)[number] * np.where(time < 60.0, 1.0, -1.0)
        commands = np.where((time > 4.0) & (time % 60.0 < 40.0), level, 0.0)[:, None] * used
        # Where it is not dead, the vehicle is held in one log.
        acts = commands * [1.0, 0.0] if is_dead else commands * (neutral if number == 5 else 1.0)
        torque, pushed = (100.0 * each @ np.array([*ARMS.values()]) for each in (commands, acts))
        disturbance, noise = gauss_markov(len(time), 0.2, 2.0, 0.2, rng), rng.normal(0.0, 1e-3, len(time))
        one = run(time, pushed, scaled(SMALL, 800.0, 40.0), cutoff=0.7, disturbance=disturbance, noise=noise)
        trial = replace(one.trial, name=f"run_{number}.csv", commands=commands)
        runs.append(replace(one, trial=trial, torque=torque, filtered_torque=one.rates.filter_held(trial, torque)))
    detectors = (*no_response.DETECTORS["runs"], *DETECTORS["runs"])
    faults = examine(detectors, RunsData(runs=runs, vehicle=TWO), FaultOverrides())[1]
    assert [fault.logs for fault in faults] == ([] if is_dead else [("run_5.csv",)])


def test_a_log_in_parts_is_judged_without_the_mean_torque_of_each() -> None:
    damage = "the commands of a have the opposite sign"
    runs = two_thrusters(damage, 3, turning=1.0)
    trial = runs[2].trial
    parts = [trial.part(slice(*rows), f"{trial.name}, {rows[0]}") for rows in pairwise((0, 150, 300, 400))]
    runs[2:3] = prepare_trials(parts, TWO, cutoff=0.7).items
    assert {log_name(run) for run in runs} == {f"run_{number}.csv" for number in range(6)}
    (fault,) = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=TWO), FaultOverrides())[1]
    assert fault.logs == ("run_2.csv",)
    assert damage in fault.text


def test_signs_that_are_wrong_in_half_of_the_logs_or_in_one_of_three_are_named() -> None:
    damage = "the heading or all commands have the opposite sign"
    for damaged, count in ({0, 3, 5}, 6), ({1}, 3):
        runs = two_thrusters(damage, 1, damaged)[:count]
        data, faults = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=TWO), FaultOverrides())
        assert {fault.logs[0] for fault in faults} == {f"run_{number}.csv" for number in damaged}
        assert len(data.runs) == count - len(damaged)
        assert all(damage in fault.text for fault in faults)


def found(runs: Sequence[Run], *, planar: bool = False) -> tuple[list[str], tuple[Fault, ...]]:
    """Names of the runs that stay, and the faults."""
    data, faults = examine(
        DETECTORS["runs"], RunsData(runs=runs, vehicle=replace(LOGGED, planar=planar)), FaultOverrides()
    )
    return [run.trial.name for run in data.runs], faults


def model(vehicle: str) -> Model:
    return VEHICLES[vehicle][0]


def test_where_a_thrust_curve_is_guessed_a_log_that_deviates_is_named_and_kept() -> None:
    guessed = replace(LOGGED, thrusters=tuple(replace(one, curve_guessed=True) for one in LOGGED.thrusters))
    runs = day("small", 1, {"steps.csv": scaled(model("small"), 1.6, 1.0)})
    for vehicle, kept in ((LOGGED, len(runs) - 1), (guessed, len(runs))):
        data, faults = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=vehicle), FaultOverrides())
        assert [fault.logs for fault in faults] == [("steps.csv",)]
        assert len(data.runs) == kept
    assert "guessed thrust curve" in faults[0].text


def test_a_foreign_log_with_most_of_the_thrust_is_no_majority() -> None:
    """Five logs: the foreign one has four times the thrust of the others, and one has hardly any."""
    others = {"steps.csv": scaled(model("small"), 0.4, 0.5)}
    names = ["hold_0.csv", "hold_1.csv", "sine_1.csv", "random.csv"]
    weak = {"hold_0.csv": 1e-4, "hold_1.csv": 0.25, "sine_1.csv": 0.25, "random.csv": 0.25, "hold_3.csv": 0.25}
    kept, faults = found([run for run in day("small", 1, others, thrust=weak) if run.trial.name in {*weak, *others}])
    assert [fault.logs for fault in faults] == [("steps.csv",)]
    assert set(names) <= set(kept)


def windy_day(vehicle: str, seed: int, size: float, foreign: str = "") -> list[Run]:
    """Holds, steps and two slow sines in a wind torque of ``size``*sin(2*heading + 0.5) N m."""
    rng = np.random.default_rng(seed)
    base, full = VEHICLES[vehicle]
    tau = base.inertia / (base.quadratic_drag * np.sqrt(full / base.quadratic_drag) + base.linear_drag)
    kept = {name: each for name, each in programme(tau, rng).items() if name.startswith(("hold", "steps"))}
    interval, runs = next(iter(kept.values()))[0], []
    for periods, level in ((14.0, 0.5), (25.0, 0.3)):
        time = clock(4.0 * periods * tau, 1.0 / interval)
        kept[f"sine_{periods:.0f}.csv"] = interval, level * np.sin(2.0 * np.pi * time / (periods * tau))
    for name, (_, planned) in kept.items():
        own = scaled(base, 2.9, 2.6) if name == foreign else base
        time, torque = interval * np.arange(len(planned), dtype=np.float64), full * planned
        disturbance = gauss_markov(len(time), interval, 0.02 * full, 2.0 * tau, rng)
        rate = angle = 0.0
        for at, driving in enumerate(torque + disturbance):
            wind = size * np.sin(2.0 * angle + 0.5)
            disturbance[at] += wind
            for _ in range(10):
                drag = (own.quadratic_drag * abs(rate) + own.linear_drag) * rate
                rate += 0.1 * interval * (driving + wind - drag) / own.inertia
                angle += 0.1 * interval * rate
        noise = rng.normal(0.0, np.deg2rad(0.05), len(time))
        one = run(time, torque, own, cutoff=min(2.0 / tau, 0.19 / interval), disturbance=disturbance, noise=noise)
        runs.append(replace(one, trial=replace(one.trial, name=name)))
    return runs


@pytest.mark.parametrize("share", [slow(0.2), 0.4])
@pytest.mark.parametrize("vehicle", ["small", slow("large")])
def test_a_sine_run_in_wind_belongs_to_the_others(vehicle: str, share: float) -> None:
    """Its heading swings with its rate: a torque of the heading looks like another inertia, even one below zero."""
    size = share * VEHICLES[vehicle][1]
    for seed in range(2, 4):
        assert found(windy_day(vehicle, seed, size))[1] == ()
        assert [fault.logs for fault in found(windy_day(vehicle, seed, size, "steps.csv"))[1]] == [("steps.csv",)]


@pytest.mark.parametrize("factor", [57.3, slow(30.0)])
def test_a_log_in_radians_is_told_so(factor: float) -> None:
    """A heading in radians that is read as degrees is a vehicle with 57.3 times the inertia."""
    others = {"sine_1.csv": scaled(model("large"), factor, factor)}
    _, (fault,) = found(day("large", 1, others, disturbance=0.002))
    assert ("in radians" in fault.text) == (factor == 57.3)


@pytest.mark.parametrize(("size", "words"), [(0.5, "half its size"), (2.0, "twice its size"), (0.7, "")])
def test_a_log_at_half_its_size_is_told_so(size: float, words: str) -> None:
    """A motion at another size is a vehicle with another inertia, and with a quadratic drag by the square of it."""
    base = model("large")
    quadratic, linear = base.quadratic_drag / size**2, base.linear_drag / size
    other = Model(inertia=base.inertia / size, quadratic_drag=quadratic, linear_drag=linear)
    _, (fault,) = found(day("large", 1, {"steps.csv": other}, disturbance=0.002))
    assert fault.logs == ("steps.csv",)
    assert "may be logged" not in fault.text if not words else f"may be logged at {words}" in fault.text


def test_a_negative_drag_alone_is_of_a_controller_that_holds_against_a_disturbance() -> None:
    fitted = fit_quick_model(day("large", 1), LOGGED)
    assert fitted is not None
    unlikely = replace(fitted.logs[0], chance=1e-6, standard_errors=np.array([0.06, 0.2]))
    for deviation, foreign in (([0.26, -2.13], False), ([-2.0, -2.13], True), ([0.9, -2.13], True), ([0.0, 1.0], True)):
        assert _is_foreign(replace(unlikely, deviation=np.array(deviation)), 6) is foreign


def test_a_log_with_the_opposite_sign_is_told_so() -> None:
    """Commands of the opposite sign are a vehicle with the opposite sign of inertia and drag."""
    kept, (fault,) = found(day("large", 1, {"steps.csv": scaled(model("large"), -1.0, -1.0)}))
    assert (fault.logs, len(kept)) == (("steps.csv",), 9)
    assert "opposite sign" in fault.text
    assert fault.size == pytest.approx(-1.0, abs=0.2)


@pytest.mark.parametrize(("factor", "logs"), [(-1.0, ["steps.csv"]), (2.9, [])])
def test_a_coupled_vehicle_has_the_same_sign_in_each_log_and_not_the_same_yaw(factor: float, logs: list[str]) -> None:
    faults = found(day("large", 1, {"steps.csv": scaled(model("large"), factor, factor)}), planar=True)[1]
    assert [log for fault in faults for log in fault.logs] == logs


@pytest.mark.parametrize("seed", [0, slow(1), slow(2)])
@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("factors", [(2.9, 2.6), slow((0.4, 0.5)), (1.0, 1.8), slow((1.8, 1.8))])
def test_foreign_logs_are_named_and_set_aside(vehicle: str, factors: tuple[float, float], seed: int) -> None:
    other = scaled(model(vehicle), *factors)
    names = ["hold_2.csv", "steps.csv"] if seed else ["steps.csv"]
    kept, faults = found(day(vehicle, seed, dict.fromkeys(names, other)))
    assert sorted(log for fault in faults for log in fault.logs) == names
    assert not set(names) & set(kept)
    assert len(kept) == 10 - len(names)
    for fault in faults:
        assert (fault.remedy, fault.stops) == ("set_aside", False)
        assert fault.confidence > 0.95
        assert fault.size is not None
        assert fault.standard_error is not None
        # The error includes the least scatter between logs.
        assert min(abs(fault.size - factor) for factor in factors) < 4.0 * fault.standard_error


@pytest.mark.parametrize("seed", [0, slow(1), slow(2)])
@pytest.mark.parametrize("vehicle", ["small", slow("large")])
@pytest.mark.parametrize("factors", [(1.0, 1.3), (1.3, 1.3), (1.3, 1.0)])
def test_two_payloads_are_named_and_nothing_is_set_aside(vehicle: str, factors: tuple[float, float], seed: int) -> None:
    names = [run.trial.name for run in day(vehicle, seed)][::2]
    runs = day(vehicle, seed, dict.fromkeys(names, scaled(model(vehicle), *factors)), disturbance=0.005)
    kept, faults = found(runs)
    assert len(kept) == 10
    (fault,) = faults
    # More thrust in some logs has the same inertia and drag at another scale: that is no payload.
    assert minority_payload(runs, LOGGED) == (fault.logs if factors[0] != factors[1] else ())
    assert (fault.remedy, fault.stops) == ("none", False)
    others = [name for name in kept if name not in names]
    # A log that hardly shows its drag may be missing, but no log is in the wrong group.
    assert set(fault.logs) <= set(names) or set(fault.logs) <= set(others)
    assert len(fault.logs) >= 4
    assert fault.size == pytest.approx(1.3, abs=0.06)  # Quick, for a message.


@pytest.mark.parametrize("vehicle", [slow("small"), "large"])
def test_two_logs_of_a_light_vehicle_do_not_move_the_model(vehicle: str) -> None:
    """They move most for their torque, and two of six logs would pull the model halfway to theirs."""
    names = {"hold_0.csv", "hold_2.csv", "sine_1.csv", "sine_2.csv", "steps.csv", "random.csv"}
    light = dict.fromkeys(("steps.csv", "random.csv"), scaled(model(vehicle), 0.17, 0.17))
    runs = [run for run in day(vehicle, 0, light) if run.trial.name in names]
    kept, faults = found(runs)
    assert {fault.logs for fault in faults} == {("steps.csv",), ("random.csv",)}
    assert {fault.remedy for fault in faults} == {"set_aside"}
    assert len(kept) == 4


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "number"), [(777001, 8), (951190, 2)])
def test_a_log_of_little_torque_does_not_hide_two_payloads(seed: int, number: int, tmp_path: Path) -> None:
    """In a weak hold the disturbance is several times the torque: a memory of the water explains a share of it."""
    truth = write_folder(tmp_path, seed, number, "foreign_log")
    study = open_study([tmp_path])
    (fault,) = study.faults
    assert list(fault.logs) == truth["logs"]
    assert fault.size == pytest.approx(truth["size"], abs=0.06)  # Quick, for a message.


@pytest.mark.parametrize(("factor", "first"), [(1.3, 5), slow(1.8, 0)])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_two_payloads_are_found_in_five_logs_and_far_apart(vehicle: str, factor: float, first: int) -> None:
    """The larger group is the origin: the mean of two payloads far apart is a model of neither."""
    names = [run.trial.name for run in day(vehicle, 0)][::2]
    runs = day(vehicle, 0, dict.fromkeys(names, scaled(model(vehicle), 1.0, factor)), disturbance=0.005)[first:]
    kept, (fault,) = found(runs)
    assert len(kept) == len(runs)
    assert fault.remedy == "none"
    assert " drag of " in fault.text
    assert fault.size == pytest.approx(factor, abs=0.1 * (factor - 1.0) + 0.02)  # Quick, for a message.


@pytest.mark.parametrize("seed", [*range(4), *map(slow, range(4, 10))])
@pytest.mark.parametrize("disturbance", [0.002, 0.02, 0.1])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_one_vehicle_gives_nothing(vehicle: str, disturbance: float, seed: int) -> None:
    kept, faults = found(day(vehicle, 100 + seed, disturbance=disturbance))
    assert len(kept) == 10
    assert not faults


@pytest.mark.parametrize("seed", range(3))
def test_a_drift_over_the_day_is_no_foreign_log(seed: int) -> None:
    """The thrust fades by 30 % from the first log to the last."""
    names = [run.trial.name for run in day("large", seed)]
    gains = dict(zip(names, np.linspace(1.0, 1.0 / 0.7, len(names)), strict=True))
    kept, faults = found(day("large", seed, {name: scaled(model("large"), gain, gain) for name, gain in gains.items()}))
    assert len(kept) == 10
    assert not faults


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_cause_that_all_logs_share_is_no_foreign_log(vehicle: str, seed: int) -> None:
    """Thrust of a quarter less in reverse, or a delay of a fifth of the time constant."""
    runs = day(vehicle, seed)
    weak = [replace(run, torque=np.where(run.torque < 0.0, run.torque / 0.75, run.torque)) for run in runs]
    later = [replace(run, torque=np.roll(run.torque, -4)) for run in runs]
    for changed in (weak, later):
        every = [replace(run, filtered_torque=run.rates.filter_held(run.trial, run.torque)) for run in changed]
        kept, faults = found(every)
        assert len(kept) == 10
        assert not faults


@pytest.mark.parametrize("drive", ["slew limit", "play"])
def test_a_log_that_shows_the_drive_of_all_is_no_foreign_log(drive: str) -> None:
    rng, runs = np.random.default_rng(5), list[Run]()
    time, vehicle = clock(60.0, 10.0), scaled(SMALL, 1.0, 0.5)
    logs = {f"hold_{number}.csv": np.where(time < 40.0, 0.3 + 0.15 * number, 0.0) for number in range(5)}
    logs["fast.csv"] = np.sin(2.0 * np.pi * time / 4.0)
    logs["fine.csv"] = 0.3 * np.sin(2.0 * np.pi * time / 9.0)
    for name, ordered in logs.items():
        acts = slewed(time, ordered, 0.5) if drive == "slew limit" else played(time, ordered, 0.35)
        noise, disturbance = rng.normal(0.0, 1e-4, len(time)), gauss_markov(len(time), 0.1, 0.005, 2.0, rng)
        one = run(time, acts, vehicle, cutoff=0.8, disturbance=disturbance, noise=noise)
        trial = replace(one.trial, name=name, commands=ordered[:, None])
        filtered = one.rates.filter_held(trial, ordered)
        runs.append(replace(one, trial=trial, torque=ordered, filtered_torque=filtered))
    before = fit_quick_model(runs, LOGGED)
    assert before is not None
    deviations = {log.name: np.abs(log.deviation).max() for log in before.logs}
    assert max(deviations.values()) == deviations["fast.csv" if drive == "slew limit" else "fine.csv"] > 0.3
    kept, faults = found(runs)
    assert len(kept) == len(logs)
    assert not faults


def test_two_logs_have_no_majority_and_three_do_if_two_agree() -> None:
    runs = {run.trial.name: run for run in day("large", 1, {"steps.csv": scaled(model("large"), 3.0, 3.0)})}
    names = ["sine_1.csv", "steps.csv", "random.csv"]
    assert not found([runs[name] for name in names[:2]])[1]
    kept, (fault,) = found([runs[name] for name in names])
    assert (fault.logs, kept) == (("steps.csv",), [names[0], names[2]])


def test_a_heading_that_is_absent_where_a_gyro_is_logged_breaks_no_model() -> None:
    runs = day("small", 3)
    whole = fit_quick_model(runs, LOGGED)
    rates = runs[4].rates
    absent = rates.time > 0.3 * rates.time[-1]
    gaps = replace(rates, position=np.where(absent, np.nan, rates.position))
    found = fit_quick_model([*runs[:4], replace(runs[4], rates=gaps), *runs[5:]], LOGGED)
    assert whole is not None
    assert found is not None
    assert abs(found.inertia / whole.inertia - 1.0) < 0.05  # the other logs hold their heading


@pytest.mark.parametrize(
    ("factor", "error", "is_sized", "text"),
    [
        (2.18, 0.29, True, "its inertia is 2.18 ± 0.29 times theirs"),
        (39.0, 18.0, False, "its own inertia is not determined"),  # 2.1 standard errors.
        (-0.38, 0.15, False, "its own inertia is not determined"),  # No vehicle has it.
        (-1.0, 0.1, True, "the opposite sign"),
    ],
)
def test_a_size_that_no_vehicle_has_is_not_printed(factor: float, error: float, is_sized: bool, text: str) -> None:
    model = fit_quick_model(day("small", 0), LOGGED)
    assert model is not None
    deviating = replace(model.logs[0], deviation=np.array([factor - 1.0, 0.0]), standard_errors=np.array([error, 1.0]))
    fault = _foreign(deviating, 10, LOGGED).fault
    assert text in fault.text
    assert (fault.size is not None, fault.standard_error is not None) == (is_sized, is_sized)
    assert fault.may_be_explained == (factor > -1.0)


def one_way_day(ratio: float, foreign: str = "") -> list[Run]:
    """Logs in both directions and one to port alone, with ``ratio`` times the drag to port; one may be ``foreign``."""
    rng, time, runs = np.random.default_rng(8), clock(60.0, 10.0), list[Run]()
    logs = {f"sine_{period}.csv": np.sin(2.0 * np.pi * time / period) for period in (6, 9, 12, 15, 20)}
    logs["port.csv"] = -rng.uniform(0.2, 1.0, 16)[(time // 4.0).astype(int)]
    for name, ordered in logs.items():
        vehicle = scaled(SMALL, 3.0 if name == foreign else 1.0, 1.0)
        rate, extra = 0.0, np.zeros(len(time))
        for at, torque in enumerate(ordered):
            drag = (vehicle.quadratic_drag * abs(rate) + vehicle.linear_drag) * rate
            extra[at] = (1.0 - ratio) * drag if rate < 0.0 else 0.0
            for _ in range(10):
                rate += 0.01 * (torque + extra[at] - drag) / vehicle.inertia
        disturbance = extra + gauss_markov(len(time), 0.1, 0.01, 2.0, rng)
        noise = rng.normal(0.0, 1e-4, len(time))
        one = run(time, ordered, vehicle, cutoff=0.8, disturbance=disturbance, noise=noise)
        runs.append(replace(one, trial=replace(one.trial, name=name)))
    return runs


def test_a_log_in_the_one_direction_of_more_drag_is_no_foreign_log() -> None:
    assert found(one_way_day(4.0))[1] == ()
    (fault,) = found(one_way_day(2.5, "sine_12.csv"))[1]
    assert fault.logs == ("sine_12.csv",)


def test_two_kinds_of_logs_without_a_majority_are_named_and_kept() -> None:
    names = ["random.csv", "steps.csv"]
    whole = day("large", 1, dict.fromkeys(names, scaled(model("large"), 3.6, 3.0)), disturbance=0.005)
    runs = [run for run in whole if run.trial.name in {*names, "sine_0.csv", "sine_1.csv"}]
    kept, faults = found(runs)
    assert sorted(log for fault in faults for log in fault.logs) == names
    assert len(kept) == len(runs)
    assert all("neither kind is a majority" in fault.text for fault in faults)


def test_another_vehicle_is_explained_by_its_own_model_and_a_disturbance_is_not() -> None:
    runs = day("large", 1, {"steps.csv": scaled(model("large"), 2.9, 2.6)}, disturbance=0.05)
    whole = fit_quick_model(runs, LOGGED)
    assert whole is not None
    assert [log.name for log in whole.logs if _explains_itself(log, whole)] == ["steps.csv"]


def test_where_every_log_deviates_none_is_left_to_explain_them() -> None:
    model = fit_quick_model(day("small", 0), LOGGED)
    assert model is not None
    assert _with_own_model(model.logs, model) == [*model.logs]
    assert _with_own_model(model.logs[:1], model) == []
