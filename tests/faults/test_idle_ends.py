"""Rest and handling at the ends of a log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.faults.base import RunsData, examine
from rovid.faults.idle_ends import DETECTORS
from rovid.trial.fault import Fault, FaultOverrides
from rovid.trial.preprocessing import Run
from tests.conftest import slow
from tests.faults.days import VEHICLES, day
from tests.faults.test_several_releases import constants, pushes
from tests.synthetic import LOGGED, clock, gauss_markov, run


def examined(runs: list[Run]) -> tuple[list[Run], tuple[Fault, ...]]:
    data, faults = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())
    return list(data.runs), faults


def idle(vehicle: str, seed: int, *, before: float, after: float, hands: tuple[float, ...] = ()) -> tuple[Run, float]:
    """(log, its test's begin in s) with ``before`` and ``after`` s without thrust around a test, and ``hands`` at s."""
    model, _ = VEHICLES[vehicle]
    full, tau = constants(vehicle)
    rng = np.random.default_rng(seed)
    interval = max(tau / 20.0, 0.05)
    test = 30.0 * tau
    time = clock(before + test + after, 1.0 / interval)
    phase = (time - before) / tau
    torque = full * np.where((phase >= 0.0) & (phase < 30.0), np.where(phase % 10.0 < 5.0, 0.8, -0.6), 0.0)
    own = gauss_markov(len(time), interval, 0.02 * full, 2.0 * tau, rng)
    own = own + pushes(time, hands, full, 3.0 * tau)
    noise = rng.normal(0.0, np.deg2rad(0.05), len(time))
    one = run(time, torque, model, cutoff=min(2.0 / tau, 0.19 / interval), disturbance=own, noise=noise)
    return replace(one, trial=replace(one.trial, name="long.csv", campaign_time=20_000.0)), before


def rest(vehicle: str) -> float:
    """Long rest in s."""
    return max(120.0, 60.0 * constants(vehicle)[1])


@pytest.mark.parametrize("seed", [0, slow(1), slow(2)])
@pytest.mark.parametrize("end", ["before", "after", "both"])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_long_rest_is_cut_off(vehicle: str, end: str, seed: int) -> None:
    _, tau = constants(vehicle)
    long = rest(vehicle)
    before, after = (0.0 if end == "after" else long), (0.0 if end == "before" else long)
    log, begin = idle(vehicle, seed, before=before, after=after)
    runs, (fault,) = examined([*day(vehicle, seed), log])
    assert (fault.fault, fault.logs, fault.remedy) == ("idle_ends", ("long.csv",), "cut")
    assert len(fault.at) == (2 if end == "both" else 1)
    assert fault.size == pytest.approx(before + after, rel=0.35)
    (left,) = (one.trial for one in runs if one.trial.name == "long.csv")
    start = left.campaign_time - 20_000.0
    # The test, a little rest before it, and the coast-down after it are there.
    assert start <= max(begin - 3.0 * tau, 0.0)
    assert start + left.duration >= min(begin + 36.0 * tau, log.trial.duration) - 1e-6
    assert left.duration < 0.6 * log.trial.duration


@pytest.mark.parametrize("seed", [0, slow(1), slow(2)])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_handling_is_cut_off(vehicle: str, seed: int) -> None:
    _, tau = constants(vehicle)
    before, after = 25.0 * tau, 25.0 * tau
    log, begin = idle(vehicle, seed, before=before, after=after, hands=(6.0 * tau, 70.0 * tau))
    runs, (fault,) = examined([*day(vehicle, seed), log])
    assert fault.fault == "idle_ends"
    assert "is moved without a command" in fault.text
    assert fault.at[0] == 0.0
    (left,) = (one.trial for one in runs if one.trial.name == "long.csv")
    start = left.campaign_time - 20_000.0
    assert 8.8 * tau <= start <= begin
    assert begin + 30.0 * tau <= start + left.duration <= 70.2 * tau


@pytest.mark.parametrize("disturbance", [0.002, 0.02, 0.1])
@pytest.mark.parametrize("seed", [0, 1, slow(2), slow(3), slow(4)])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_usual_rest_and_coast_downs_stay(vehicle: str, seed: int, disturbance: float) -> None:
    """A coast-down of 15 time constants ends each hold of the day."""
    _, tau = constants(vehicle)
    log, _ = idle(vehicle, seed, before=8.0 * tau, after=8.0 * tau)
    runs = [*day(vehicle, seed, disturbance=disturbance), log]
    kept, faults = examined(runs)
    assert not faults
    assert kept == runs


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_tether_that_untwists_is_no_hand(vehicle: str) -> None:
    model, _ = VEHICLES[vehicle]
    full, tau = constants(vehicle)
    interval = max(tau / 20.0, 0.05)
    time = clock(40.0 * tau, 1.0 / interval)
    torque = np.where((time > 3.0 * tau) & (time < 25.0 * tau), full, 0.0)
    rate, angle, spring = 0.0, 0.0, np.zeros(len(time))
    stiffness = 0.7 * full / (15.0 * tau * np.sqrt(full / model.quadratic_drag))
    for k in range(len(time)):
        spring[k] = -stiffness * angle
        for _ in range(10):
            drag = (model.quadratic_drag * abs(rate) + model.linear_drag) * rate
            rate += 0.1 * interval * (torque[k] - stiffness * angle - drag) / model.inertia
            angle += 0.1 * interval * rate
    assert rate < 0.0  # It turns back without a command.
    noise = np.random.default_rng(7).normal(0.0, 1e-3, len(time))
    one = run(time, torque, model, cutoff=min(2.0 / tau, 0.19 / interval), disturbance=spring, noise=noise)
    one = replace(one, trial=replace(one.trial, name="long.csv", campaign_time=20_000.0))
    assert not examined([*day(vehicle, 1), one])[1]
