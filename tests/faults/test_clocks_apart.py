"""Commands and motion on clocks with an offset."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.faults.base import RunsData, detectors_at, examine
from rovid.faults.clock_drift import clock_drift
from rovid.faults.clocks_apart import DETECTORS
from rovid.faults.log_regressors import first_order
from rovid.faults.quick_model import fit_quick_model
from rovid.faults.response_delay import far_delay, response_delay
from rovid.faults.several_releases import _unexplained
from rovid.trial.fault import Fault, FaultOverrides
from rovid.trial.preprocessing import Run, prepare_trials
from tests import synthetic
from tests.conftest import SAMPLES, Rovid, slow
from tests.faults.days import VEHICLES, day, programme
from tests.synthetic import LOGGED, gauss_markov
from tools.programme import CAMPAIGN
from tools.trial_day import write_trial_day


def faults(runs: Sequence[Run]) -> tuple[Fault, ...]:
    return examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())[1]


def shifted(run: Run, samples: int) -> Run:
    """``run`` with its commands ``samples`` later."""
    torque = np.roll(run.torque, samples)
    return replace(run, torque=torque, filtered_torque=run.rates.filter_held(run.trial, torque))


def test_few_steps_show_clocks_that_explain_most_of_the_torque() -> None:
    """Four steps of two holds: too few for an error of five blocks."""
    runs = [run for run in day("small", 1) if run.trial.name in {"hold_2.csv", "hold_4.csv"}]
    assert not faults(runs)
    (fault,) = faults([shifted(run, 30) for run in runs])
    assert (fault.fault, fault.stops, len(fault.logs)) == ("clocks_apart", True, 2)
    assert fault.size == pytest.approx(-30 * runs[0].trial.sampling_interval, rel=0.05)


def test_a_position_may_be_absent_where_a_rate_is_logged() -> None:
    """Drift, delay and the torque of hands use the readings that hold both."""
    runs = list[Run]()
    for run in day("small", 1):
        gone = np.abs(np.linspace(-1.0, 1.0, len(run.rates.time))) < 0.3
        runs.append(replace(run, rates=replace(run.rates, position=np.where(gone, np.nan, run.rates.position))))
    drift, delay, model = clock_drift(runs), response_delay(runs, memories=(1.0, 4.0)), fit_quick_model(runs, LOGGED)
    assert drift is not None
    assert abs(drift.drift) < 4.0 * drift.error
    assert delay is not None
    assert abs(delay.delay) < 4.0 * delay.error + 0.02  # s; the disturbance.
    assert model is not None
    assert np.isfinite(_unexplained(runs[-1], model)).all()


def test_shifts_that_leave_no_reading_determine_no_delay() -> None:
    """A heading with a long gap, and a command that ends before it: at many shifts no reading has both."""
    for run in day("small", 1):
        place = np.linspace(0.0, 1.0, len(run.valid))
        rate = np.where((place > 0.2) & (place < 0.95), np.nan, run.rates.rate)
        torque = np.where(place > 0.3, np.nan, run.filtered_torque)
        patchy = replace(run, rates=replace(run.rates, rate=rate), filtered_torque=torque)
        for values in (None, np.array([0.6, 1.5, 0.3, 0.0])):
            found = far_delay([patchy], values)
            assert found is None or np.isfinite(found.delay)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_water_that_follows_the_hull_is_no_early_motion(vehicle: str) -> None:
    """An added mass that comes with a time constant lets the motion begin faster than it goes on."""
    runs = list[Run]()
    for one in day(vehicle, 1, disturbance=0.005):
        rates, period = one.rates, one.rates.kernel.period
        memory = 6.0 / rates.kernel.cutoff
        rate = np.nan_to_num(rates.rate)
        water = 1.5 * VEHICLES[vehicle][0].inertia / memory * (rate - first_order(rate, memory, period))
        torque = one.torque + np.interp(one.trial.time, rates.time, water)
        runs.append(replace(one, torque=torque, filtered_torque=rates.filter_held(one.trial, torque)))
    assert not faults(runs)


@pytest.mark.parametrize("seed", [*range(2), *map(slow, range(2, 5))])
@pytest.mark.parametrize("samples", [3, 10])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_motion_before_the_commands_stops(vehicle: str, samples: int, seed: int) -> None:
    runs = [shifted(run, samples) for run in day(vehicle, seed)]
    (fault,) = faults(runs)
    assert fault.stops
    assert len(fault.logs) == 10
    assert fault.size is not None
    assert fault.standard_error is not None
    interval = runs[0].trial.sampling_interval
    # A fifth of an interval: the parabola through three shifts.
    assert abs(fault.size + samples * interval) < 4.0 * fault.standard_error + 0.2 * interval


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_commands_that_repeat_themselves_are_late_by_no_period(vehicle: str) -> None:
    """A sine that is shifted by a period fits as well; commands are 2 samples early, as by a lag."""
    runs = [shifted(run, -2) for run in day(vehicle, 0)]
    common = response_delay(runs)
    assert common is not None
    sines = [run for run in runs if run.trial.name.startswith("sine")]
    assert len(sines) == 3
    for run in sines:
        found = response_delay([run], common.values)
        assert found is not None
        # The shortest period is 50 samples.
        assert abs(found.delay - 2.0 * run.trial.sampling_interval) < 10.0 * run.trial.sampling_interval


@pytest.mark.parametrize(("name", "samples"), [("random.csv", 10), ("random.csv", -200), ("steps.csv", 200)])
def test_the_log_with_the_offset_is_named_and_set_aside(name: str, samples: int) -> None:
    runs = [shifted(run, samples) if run.trial.name == name else run for run in day("large", 1)]
    data, (fault,) = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())
    assert (fault.logs, fault.stops, fault.remedy) == ((name,), False, "set_aside")
    assert name not in {run.trial.name for run in data.runs}
    assert fault.size is not None
    interval = runs[0].trial.sampling_interval
    assert abs(fault.size + samples * interval) < 0.5 * interval


@pytest.mark.parametrize("samples", [10, 40])
def test_commands_that_come_late_are_no_hand_that_moves_the_vehicle(samples: int) -> None:
    runs = [shifted(run, samples) if run.trial.name == "random.csv" else run for run in day("small", 1)]
    runs = [replace(run, trial=replace(run.trial, commands=run.torque[:, None])) for run in runs]
    every = examine(detectors_at("runs"), RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())[1]
    assert [(fault.fault, fault.logs) for fault in every] == [("clocks_apart", ("random.csv",))]


def test_two_logs_have_no_majority() -> None:
    runs = [run for run in day("large", 1) if run.trial.name in {"random.csv", "steps.csv"}]
    (fault,) = faults([runs[0], shifted(runs[1], 10)])
    assert (fault.logs, fault.stops) == ((runs[1].trial.name,), True)
    assert not faults([runs[0], shifted(runs[1], -10)])


@pytest.mark.parametrize("samples", [300, -300])
def test_clocks_further_apart_than_any_delay_stop(samples: int) -> None:
    runs = [shifted(run, samples) for run in day("large", 1)]
    (fault,) = faults(runs)
    assert (len(fault.logs), fault.stops) == (10, True)
    assert fault.size is not None
    interval = runs[0].trial.sampling_interval
    assert abs(fault.size + samples * interval) < 0.5 * interval


def test_commands_of_the_opposite_sign_are_no_clock() -> None:
    """In a sine half a period looks like the other sign."""
    runs = [
        replace(one, torque=-one.torque, filtered_torque=-one.filtered_torque)
        if one.trial.name in {"sine_1.csv", "steps.csv"}
        else one
        for one in day("large", 1)
    ]
    assert not faults(runs)


@pytest.mark.parametrize("seed", [*range(4), *map(slow, range(4, 10))])
@pytest.mark.parametrize("disturbance", [0.002, 0.1])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_one_clock_gives_nothing(vehicle: str, disturbance: float, seed: int) -> None:
    runs = day(vehicle, 50 + seed, disturbance=disturbance)
    assert not faults(runs)
    # A delay of the thrusters is no fault of one log.
    assert not faults([shifted(run, -5) for run in runs])


def joined(run: Run) -> Run:
    return replace(run, trial=replace(run.trial, companion_files=(Path("thrusters.csv"),)))


@pytest.mark.parametrize("ppm", [17_000.0, -17_000.0, 4_000.0, -2_000.0])
def test_a_drift_between_joined_files_stops(ppm: float) -> None:
    runs = []
    for run in map(joined, day("large", 3)):
        # The clock of the commands runs fast.
        at = np.searchsorted(run.trial.time, (1.0 - 1e-6 * ppm) * run.trial.time, side="right") - 1
        torque = run.torque[at]
        runs.append(replace(run, torque=torque, filtered_torque=run.rates.filter_held(run.trial, torque)))
    (fault,) = faults(runs)
    assert (fault.stops, fault.unit) == (True, "ppm")
    assert fault.size is not None
    assert fault.standard_error is not None
    assert abs(fault.size + ppm) < 4.0 * fault.standard_error


def test_one_joined_log_is_examined_too() -> None:
    drift = clock_drift([joined(day("large", 0)[6])])
    assert drift is not None
    assert abs(drift.drift) < 4.0 * drift.error


@pytest.mark.parametrize("seed", [*range(3), *map(slow, range(3, 6))])
@pytest.mark.parametrize("cause", ["lag", "sag"])
def test_a_hidden_cause_of_joined_files_is_no_drift(cause: str, seed: int) -> None:
    """A lag that is longer where the torque falls, or thrust that sags by a third within each log."""
    rng, (model, full) = np.random.default_rng(seed), VEHICLES["small"]
    runs = []
    for interval, planned in programme(0.4, rng).values():
        time, thrust, lagged = interval * np.arange(float(len(planned))), np.zeros(len(planned)), 0.0
        for row, aim in enumerate(planned):
            lagged += (aim - lagged) * interval / (0.1 if abs(aim) > abs(lagged) else 0.3)
            thrust[row] = lagged if cause == "lag" else aim * (1.0 - row / 3.0 / len(planned))
        noise = rng.normal(0.0, np.deg2rad(0.05), len(time))
        disturbance = gauss_markov(len(time), interval, 0.05 * full, 0.8, rng)
        one = synthetic.run(time, full * thrust, model, cutoff=3.8, disturbance=disturbance, noise=noise)
        one = replace(one, trial=replace(one.trial, commands=full * planned[:, None]))
        runs.append(joined(replace(one, filtered_torque=one.rates.filter_held(one.trial, full * planned))))
    assert all(fault.unit != "ppm" for fault in faults(runs))
    assert clock_drift(runs) is not None


def test_a_delay_of_joined_files_is_a_rival() -> None:
    runs = [joined(run) for run in day("large", 0)]
    assert not faults(runs)
    moving = [replace(run, trial=replace(run.trial, commands=run.torque[:, None])) for run in runs]
    (fault,) = faults([shifted(run, -8) for run in moving])
    assert (fault.remedy, fault.stops) == ("none", False)
    assert fault.confidence < 0.95
    assert fault.size is not None
    assert fault.size > 0.0


@pytest.mark.parametrize(("late", "left"), [("heading", "yaw rate"), ("logged yaw rate", "heading"), ("", "")])
def test_a_sensor_that_is_late_against_the_other_is_left_out(late: str, left: str) -> None:
    days, rng, delay = day("small", 0), np.random.default_rng(1), 0.0
    trials = []
    for run in days:
        time, delay = run.trial.time, 6.0 * run.trial.sampling_interval
        rate = np.interp(time, run.rates.time, run.rates.rate) + rng.normal(0.0, run.rates.rate_noise, len(time))
        position = run.trial.position
        if late == "heading":
            position = np.interp(time - delay, time, position)
        elif late:
            rate = np.interp(time - delay, time, rate)
        trials.append(replace(run.trial, position=position, rate=rate))
    runs = prepare_trials(trials, LOGGED, cutoff=days[0].rates.kernel.cutoff).items
    data, found = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())
    if not late:
        assert not found
        return
    (fault,) = found
    assert fault.text.startswith(f"The {late} is ")
    assert fault.remedy == "left_out"
    assert fault.size is not None
    # A tenth: the filter of the rates smooths a logged rate twice.
    assert abs(abs(fault.size) - delay) < 0.1 * delay
    kept = [run.trial for run in data.runs]
    assert all(trial.rate_only if left == "yaw rate" else trial.rate is None for trial in kept)


@pytest.mark.parametrize("seconds", [1.5, 2.0, 6.0])
def test_a_log_shorter_than_the_shifts_has_no_delay(seconds: float) -> None:
    time = synthetic.clock(seconds)
    run = synthetic.run(time, np.full(len(time), 100.0), cutoff=4.0)
    assert response_delay([run]) is None


def test_a_coast_next_to_a_hold_that_determines_no_model_is_not_early(tmp_path: Path, rovid: Rovid) -> None:
    """No shift fits a vehicle, and none is stated."""
    campaign = [one for one in CAMPAIGN if one.name in {"hold_01", "coast_02"}]
    write_trial_day(tmp_path / "day", seed=7, campaign=campaign)
    found = rovid("check", "day", "--json").document["faults"]
    assert not [fault for fault in found if fault["fault"] == "clocks_apart"]


@pytest.mark.parametrize(
    "logs", [["sine_20s.mcap"], ["hold_02.csv", "sine_20s.mcap"], ["hold_04.csv", "sine_80s.csv"]], ids=" ".join
)
def test_one_or_two_logs_of_a_sine_have_one_clock(logs: list[str], tmp_path: Path, rovid: Rovid) -> None:
    for name in (*logs, "thrust_curve.csv", "rovid.toml"):
        shutil.copy(SAMPLES / "rosub_tank" / name, tmp_path)
    found = rovid("check", tmp_path, "--json").document["faults"]
    assert not [fault for fault in found if fault["fault"] == "clocks_apart"]
