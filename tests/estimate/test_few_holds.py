"""Errors of drag from few holds, under disturbances that last from a tenth of a hold to ten holds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rovid.core.errors import DataError
from rovid.estimate.estimate import Estimate
from rovid.estimate.steady_drag import NAMES, fit_drag
from rovid.estimate.steady_points import SteadyPoint, long_run_variance, part_means
from tests import synthetic
from tests.conftest import slow

TRUTH = {"quadratic_drag": 2200.0, "linear_drag": 120.0}
HOLD = 40  # s, with one mean of the rate a second
TORQUES = (24.0, 34.0, 44.0, 58.0, 72.0)
DRAWS = 100


def steady_point(torque: float, disturbance: np.ndarray, start: float, rng: np.random.Generator) -> SteadyPoint:
    """A hold of a vehicle that follows the torque at once, reduced as by `steady_points`."""
    total, (square, linear) = torque + disturbance, TRUTH.values()
    rate = np.sign(total) * (np.sqrt(linear**2 + 4.0 * square * np.abs(total)) - linear) / (2.0 * square)
    rate = rate + rng.normal(0.0, 2e-4, HOLD)
    x = np.arange(HOLD) - 0.5 * (HOLD - 1)
    slope, mean = float(x @ rate / (x @ x)), float(rate.mean())
    variance = long_run_variance(rate - mean - slope * x)
    drift, drift_error = slope * HOLD, math.sqrt(variance / float(x @ x)) * HOLD
    return SteadyPoint(
        source="log",
        start=start,
        stop=start + HOLD,
        command=(1.0,),
        torque=torque,
        rate=mean,
        square_rate=float((np.abs(rate) * rate).mean()),
        rate_error=math.sqrt(variance / HOLD),
        drift=drift,
        drift_error=drift_error,
        steady=abs(drift) <= max(3.0 * drift_error, 0.005 * abs(mean)),
        parts=part_means(np.abs(rate) * rate, rate),
    )


def drawn(count: int, memory: float, rng: np.random.Generator, *, one_way: bool) -> list[SteadyPoint]:
    """``count`` holds in one log, with a disturbance of 1 N m and a ``memory`` in holds."""
    disturbance = synthetic.gauss_markov(count * HOLD, 1.0, 1.0, memory * HOLD, rng).reshape(count, HOLD)
    ways = np.ones(count) if one_way else rng.choice((-1.0, 1.0), count)
    torques = ways * rng.choice(TORQUES, count)
    return [steady_point(float(torques[at]), disturbance[at], float(at * HOLD), rng) for at in range(count)]


def answers(count: int, memory: float, *, one_way: bool) -> list[Estimate]:
    """The estimates of all draws that determine both drags."""
    rng, found = np.random.default_rng(count), []
    for _ in range(DRAWS):
        try:
            estimate = fit_drag(drawn(count, memory, rng, one_way=one_way)).estimate
        except DataError:
            continue
        if not estimate.refused:
            found.append(estimate)
    return found


@pytest.mark.parametrize("one_way", [False, True])
@pytest.mark.parametrize("memory", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("count", [4, 5, 8, slow(20)])
def test_three_standard_errors_hold_at_any_number_of_holds(count: int, memory: float, *, one_way: bool) -> None:
    found = answers(count, memory, one_way=one_way)
    assert len(found) >= (DRAWS // 10 if count < 8 else DRAWS // 2)
    off = [max(abs(one.value(name) - TRUTH[name]) / one.standard_error(name) for name in NAMES) > 3.0 for one in found]
    # One in a hundred is expected of each drag; more than four have a probability of 1 in 300.
    assert sum(off) <= 4


def test_many_holds_have_errors_of_the_disturbance() -> None:
    """Errors are not wide for nothing: with 20 holds they are as large as the scatter of the estimates."""
    found = answers(20, 0.1, one_way=False)
    values = [one.value("quadratic_drag") for one in found]
    usual = float(np.median([one.standard_error("quadratic_drag") for one in found]))
    # The standard deviation of a hundred draws has an error of 7 %; the worst memory costs up to a half.
    assert usual < 1.7 * float(np.std(values))


@pytest.mark.parametrize("count", [2, 3])
def test_too_few_holds_are_refused_by_name(count: int) -> None:
    points = drawn(4, 0.1, np.random.default_rng(3), one_way=False)
    steady = [point for point in points if point.steady][:count]
    with pytest.raises(DataError, match=f"{count} steady turns are too few for 2 unknowns: a disturbance that"):
        fit_drag(steady)


@pytest.mark.parametrize("memory", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("count", [12, slow(24)])
def test_three_standard_errors_hold_in_each_direction(count: int, memory: float) -> None:
    rng, off, fits, differ = np.random.default_rng(count), 0, 0, 0
    for _ in range(DRAWS):
        fit = fit_drag(drawn(count, memory, rng, one_way=False))
        differ += any("two directions differ" in warning for warning in fit.estimate.warnings)
        for one in fit.directions.values():
            fits += 1
            off += max(abs(one.value(name) - TRUTH[name]) / one.standard_error(name) for name in NAMES) > 3.0
    assert fits >= DRAWS
    # Expected are one in a hundred of each drag, and one in a hundred draws whose directions differ by chance.
    assert off <= 0.04 * fits
    assert differ <= 4
