"""Several tests in one log, with a hand that moves the vehicle between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.faults.base import RunsData, TrialData, examine
from rovid.faults.several_releases import DETECTORS
from rovid.trial.axis import AXES
from rovid.trial.fault import Fault, FaultOverrides
from rovid.trial.preprocessing import Run
from rovid.trial.rates import compute_rates
from rovid.trial.vehicle import Vehicle
from tests.faults.days import VEHICLES, day
from tests.synthetic import LOGGED, clock, gauss_markov, run, trial

NO_OVERRIDES = FaultOverrides()


def examined(runs: list[Run], overrides: FaultOverrides = NO_OVERRIDES) -> tuple[list[Run], tuple[Fault, ...]]:
    data, faults = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), overrides)
    return list(data.runs), faults


def constants(vehicle: str) -> tuple[float, float]:
    """(full torque in N m, time constant in s) of a vehicle at full torque."""
    model, full = VEHICLES[vehicle]
    rate = np.sqrt(full / model.quadratic_drag)
    return full, model.inertia / (model.quadratic_drag * rate + model.linear_drag)


def pushes(time: FloatArray, at: tuple[float, ...], torque: float, seconds: float) -> FloatArray:
    """(n,) N m of hands that push from each instant of ``at`` in s."""
    hands = np.zeros(len(time))
    for instant in at:
        hands += torque * ((time >= instant) & (time < instant + seconds))
    return hands


def several(vehicle: str, seed: int, at: tuple[float, ...], strength: float) -> Run:
    """Log of three tests of 20 time constants, with rest of 12 between them and hands at these time constants."""
    model, _ = VEHICLES[vehicle]
    full, tau = constants(vehicle)
    rng = np.random.default_rng(seed)
    interval = max(tau / 20.0, 0.05)
    time = clock(96.0 * tau, 1.0 / interval)
    phase = (time / tau) % 32.0
    torque = full * np.where(phase < 10.0, 0.8, np.where(phase < 20.0, -0.6, 0.0))
    torque[time < tau] = 0.0
    own = gauss_markov(len(time), interval, 0.02 * full, 2.0 * tau, rng)
    hands = pushes(time, tuple(tau * each for each in at), strength * full, 2.0 * tau)
    noise = rng.normal(0.0, np.deg2rad(0.05), len(time))
    cutoff = min(2.0 / tau, 0.19 / interval)
    one = run(time, torque, model, cutoff=cutoff, disturbance=own + hands, noise=noise)
    return replace(one, trial=replace(one.trial, name="day.csv", campaign_time=20_000.0))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("strength", [0.6, -1.0])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_hands_between_tests_are_cut_out(vehicle: str, strength: float, seed: int) -> None:
    _, tau = constants(vehicle)
    log = several(vehicle, seed, (25.0, 57.0), strength)
    runs, faults = examined([*day(vehicle, seed), log])
    (fault,) = faults
    assert (fault.fault, fault.logs, fault.size, fault.remedy) == ("several_releases", ("day.csv",), 3.0, "cut")
    assert fault.at == pytest.approx((25.0 * tau, 57.0 * tau), abs=2.0 * tau)
    parts = [one for one in runs if (one.trial.parent or one.trial.name) == "day.csv"]
    assert len(parts) == 3
    # No part holds an instant at which a hand pushed.
    begins = [one.trial.campaign_time - 20_000.0 for one in parts]
    held = [(begin, begin + one.trial.duration) for begin, one in zip(begins, parts, strict=True)]
    for hand in (25.0 * tau, 57.0 * tau):
        assert not any(begin < hand + 1.8 * tau and end > hand + 0.2 * tau for begin, end in held)


@pytest.mark.parametrize("disturbance", [0.002, 0.02, 0.1])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_undamaged_days_hold_one_test_a_log(vehicle: str, seed: int, disturbance: float) -> None:
    runs = [*day(vehicle, seed, disturbance=disturbance), several(vehicle, seed, (), 0.0)]
    kept, faults = examined(runs)
    assert not faults
    assert kept == runs


@pytest.mark.parametrize("lag", [0.5, 1.0])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_thrust_that_lags_is_no_hand(vehicle: str, lag: float) -> None:
    """Thrust goes on after the command has ended and makes the vehicle faster; ``lag`` in time constants."""
    model, _ = VEHICLES[vehicle]
    full, tau = constants(vehicle)
    interval = max(tau / 20.0, 0.05)
    time = clock(60.0 * tau, 1.0 / interval)
    torques = [one.torque for one in day(vehicle, 1)]
    torques.append(np.where((time / tau) % 20.0 < 1.0, full, 0.0))
    runs = []
    for number, torque in enumerate(torques):
        own = interval * np.arange(len(torque), dtype=np.float64)
        late = np.interp(own - lag * tau, own, torque) - torque
        noise = np.random.default_rng(number).normal(0.0, np.deg2rad(0.05), len(torque))
        one = run(own, torque, model, cutoff=min(2.0 / tau, 0.19 / interval), disturbance=late, noise=noise)
        runs.append(replace(one, trial=replace(one.trial, name=f"{number}.csv", campaign_time=1000.0 * number)))
    assert not examined(runs)[1]


def test_the_log_stays_whole_if_the_user_keeps_it() -> None:
    runs = [*day("small", 2), several("small", 2, (25.0,), 1.0)]
    kept, (fault,) = examined(runs, FaultOverrides(kept={"several_releases": ("day.csv",)}))
    assert (fault.remedy, kept) == ("none", runs)


def _rounded(one: Run, step: float) -> Run:
    """The run with the position rounded to ``step`` rad, as some compasses give it."""
    trial = replace(one.trial, position=step * np.round(one.trial.position / step))
    return replace(one, trial=trial, rates=compute_rates(trial, cutoff=one.rates.kernel.cutoff))


def test_the_steps_of_a_coarse_heading_are_no_hand() -> None:
    """Headings in steps of 5 deg, and of 2 deg in a log where a hand turns the vehicle."""
    runs = day("large", 4, disturbance=0.005)
    coarse = [_rounded(one, np.deg2rad(5.0)) if one.trial.name in {"steps.csv", "random.csv"} else one for one in runs]
    assert not examined(coarse)[1]
    _, faults = examined([*runs, _rounded(several("large", 4, (24.0,), 1.0), np.deg2rad(2.0))])
    assert [fault.logs for fault in faults] == [("day.csv",)]


@pytest.mark.parametrize("count", [0, 2])
def test_rest_that_toggles_by_one_step_is_no_release(count: int) -> None:
    """A roll in whole degrees, which toggles to both sides at the end of a decay; and a second release."""
    time = clock(240.0, 10.0)
    decays = [
        np.where(time < at, size, size * np.exp(-(time - at) / 25.0) * np.cos(1.2 * (time - at)))
        for at, size in ((5.0, 10.0), (120.0, 8.0))
    ]
    position = decays[0] + (np.where(time > 115.0, decays[1], 0.0) if count else 0.0)
    released = trial(time, np.zeros(len(time)), np.deg2rad(np.round(position)))
    released = replace(released, axis=AXES["roll"], commands=np.zeros((len(time), 0)))
    found = list(DETECTORS["trial"][0](TrialData(trial=released, vehicle=Vehicle(name="v", thrusters=()))))
    assert [detection.fault.size for detection in found] == ([count] if count else [])
