"""Drag from steady motion, also of few holds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.formatting import plus_minus
from rovid.estimate.estimate import Estimate
from rovid.estimate.steady_drag import NAMES, fit_drag
from rovid.estimate.steady_points import (
    SteadyPoint,
    TorqueBalance,
    long_run_variance,
    part_means,
    points_from_table,
    pooled_errors,
)
from rovid.trial.axis import AXES, YAW
from rovid.trial.tables import read_table
from tests import synthetic
from tests.conftest import SAMPLES, slow

PAPER = SAMPLES / "rosub_paper" / "table3.csv"
TURNS = (-0.2, -0.1, -0.06, 0.06, 0.1, 0.2)


def point(rate: float, torque: float, *, error: float = math.nan, steady: bool = True) -> SteadyPoint:
    return SteadyPoint(
        source=f"log at {rate:g} rad/s",
        start=0.0,
        stop=100.0,
        command=(1.0,),
        torque=torque,
        rate=rate,
        square_rate=abs(rate) * rate,
        rate_error=error,
        drift=0.01,
        drift_error=1e-4,
        steady=steady,
    )


def truth(rate: float) -> float:
    return 3532.0 * abs(rate) * rate + 132.0 * rate


def test_paper_table_by_ordinary_least_squares() -> None:
    # Facts worked out from the table's five rows with the normal equations.
    fit = fit_drag(points_from_table(read_table(PAPER)))
    drag = fit.estimate
    assert drag.value("quadratic_drag") == pytest.approx(3610.4, abs=0.1)
    assert drag.standard_error("quadratic_drag") == pytest.approx(315, abs=1)
    assert drag.value("linear_drag") == pytest.approx(103.1, abs=0.1)
    assert drag.standard_error("linear_drag") == pytest.approx(61.3, abs=0.1)
    assert drag.correlation("quadratic_drag", "linear_drag") == pytest.approx(-0.98, abs=0.005)
    assert fit.r_squared == pytest.approx(0.9961, abs=5e-5)
    low, high = drag.interval("linear_drag")
    assert (low, high) == pytest.approx((-92, 298), abs=1)
    (said,) = (text for text in drag.warnings if "linear_drag is not significantly different from zero" in text)
    assert "need slower holds" in said
    # Without the fastest row: DQ 4158, DL 20, and that row is off by 13.8 N m.
    assert fit.left_out[-1] == pytest.approx([4158, 19.9, -13.8], rel=0.01)


def test_faster_holds_are_asked_for_where_the_quadratic_drag_is_not_seen() -> None:
    rates = (-0.03, -0.02, -0.01, 0.01, 0.02, 0.03)
    drag = fit_drag([point(r, truth(r) + 0.3 * (-1) ** at, error=1e-4) for at, r in enumerate(rates)]).estimate
    (said,) = (text for text in drag.warnings if "quadratic_drag is not significantly" in text)
    assert "need faster holds" in said


def test_torque_errors_are_known_for_logs_only() -> None:
    table = fit_drag(points_from_table(read_table(PAPER)))
    assert not table.torque_error_known
    assert (table.torque_error == 1.0).all()
    logs = fit_drag([point(r, truth(r), error=1e-4) for r in (-0.2, -0.1, -0.03, 0.03, 0.1, 0.2)])
    assert logs.torque_error_known


def test_exact_data_give_exact_drag() -> None:
    fit = fit_drag([point(r, truth(r), error=1e-4) for r in (-0.2, -0.1, -0.03, 0.03, 0.1, 0.2)])
    assert fit.estimate.values == pytest.approx([3532.0, 132.0], rel=1e-9)
    assert np.abs(fit.residuals).max() < 1e-9


def test_one_speed_refuses_linear_drag_by_name() -> None:
    fit = fit_drag([point(r, truth(r), error=1e-3) for r in (0.2, -0.2, 0.201)])
    assert "linear_drag" in fit.estimate.refused
    assert fit.estimate.value("linear_drag") == 0.0
    assert any("linear_drag is not determined" in text for text in fit.estimate.warnings)


def test_an_impossible_rate_is_named() -> None:
    points = [point(r, truth(r)) for r in (-0.2, 0.1, 0.15, 0.2)]
    points[1] = replace(point(1e15, 30.0), source="steady.csv:3")
    with pytest.raises(
        DataError, match=r"quadratic_drag from linear_drag: .* in steady.csv:3, 1e\+15 rad/s, is so large that all"
    ):
        fit_drag(points)


def test_too_few_rates_for_all_unknowns_are_refused() -> None:
    with pytest.raises(DataError, match="from linear_drag from net_buoyancy: there are too few different rates"):
        fit_drag([point(r, truth(r), error=1e-3) for r in (0.1, 0.2, 0.1, 0.2)], AXES["heave"])


def test_leaving_out_the_only_other_rate_gives_nan() -> None:
    fit = fit_drag([point(r, truth(r), error=1e-4) for r in (0.1, 0.1, 0.1, 0.2)])
    assert fit.estimate.values == pytest.approx([3532.0, 132.0], rel=1e-9)
    assert np.isnan(fit.left_out[-1]).all()
    assert fit.left_out[:-1, :2] == pytest.approx(np.array([[3532.0, 132.0]] * 3), rel=1e-9)


def test_a_direction_that_does_not_determine_both_is_not_fitted_alone() -> None:
    rates = (0.001, 0.1, 1e9, -1e3, -2e5, -3e8)
    fit = fit_drag([point(r, truth(r)) for r in rates])
    assert list(fit.directions) == ["down"]


def test_a_negligible_rate_is_rest() -> None:
    points = [point(r, truth(r)) for r in (-0.2, 0.1, 0.15, 0.2)]
    assert fit_drag([*points, point(1e-200, 30.0)]).estimate.samples == 4


def test_negative_linear_drag_is_held_at_zero_with_a_warning() -> None:
    fit = fit_drag([point(r, 4000 * r * abs(r) - 20 * r, error=1e-3) for r in (-0.2, -0.1, 0.1, 0.15, 0.2)])
    assert fit.estimate.value("linear_drag") == 0.0
    assert fit.estimate.standard_error("linear_drag") > 0.0
    assert any("came out negative" in text for text in fit.estimate.warnings)


def test_directions_that_differ_give_a_warning() -> None:
    points = [point(r, truth(r) * (1.0 if r > 0 else 0.8), error=2e-4) for r in (-0.25, -0.2, -0.15, -0.1, -0.05)]
    points += [point(r, truth(r), error=2e-4) for r in (0.05, 0.1, 0.15, 0.2, 0.25)]
    fit = fit_drag(points)
    (warning,) = (text for text in fit.estimate.warnings if "two directions differ" in text)
    for one in fit.directions.values():
        assert plus_minus(one.value("quadratic_drag"), one.standard_error("quadratic_drag")) in warning
    assert fit.directions["up"].value("quadratic_drag") > 1.1 * fit.directions["down"].value("quadratic_drag")


@pytest.mark.slow
def test_equal_directions_give_no_warning() -> None:
    rng = np.random.default_rng()
    alarms = 0
    for _ in range(200):
        rates = np.array([-0.25, -0.2, -0.15, -0.1, -0.05, 0.05, 0.1, 0.15, 0.2, 0.25])
        fit = fit_drag([point(r, truth(r) + rng.normal(0, 1.0), error=1e-3) for r in rates])
        alarms += any("two directions differ" in text for text in fit.estimate.warnings)
    assert alarms <= 10  # tested at 1 %: 2 expected, more than 10 has a chance of 1e-5


@pytest.mark.slow
def test_standard_errors_hold_in_repetition() -> None:
    rng = np.random.default_rng()
    rates = np.array([-0.22, -0.17, -0.1, -0.05, 0.05, 0.1, 0.17, 0.22])
    z = []
    for _ in range(300):
        slope = 2 * 3532 * np.abs(rates) + 132
        fit = fit_drag(
            [point(r, truth(r) + rng.normal(0, 1.0), error=1.0 / s) for r, s in zip(rates, slope, strict=True)]
        )
        errors = np.sqrt(np.diag(fit.estimate.covariance))
        z.append((fit.estimate.values - [3532, 132]) / errors)
    # The scatter ratio only ever inflates, so the spread is at most one; 300 repetitions know it to 4 %.
    # The errors allow for a disturbance that outlasts a hold, which white noise does not need.
    assert 0.6 < np.std(z) < 1.08


def test_unsteady_holds_are_shown_but_not_fitted() -> None:
    good = [point(r, truth(r), error=1e-4) for r in (-0.2, -0.1, 0.05, 0.1, 0.2)]
    fit = fit_drag([*good, point(0.15, 500.0, error=1e-4, steady=False)])
    assert len(fit.points) == 5
    assert len(fit.unsteady) == 1


def test_without_a_steady_turn_the_message_advises_runs() -> None:
    with pytest.raises(DataError, match=r"no held command.*Run held commands"):
        fit_drag([])
    with pytest.raises(DataError, match="still changing"):
        fit_drag([point(0.1, 50.0, error=1e-3, steady=False)])


def at_rest(rate: float, torque: float) -> SteadyPoint:
    """Ten minutes in a current that turns the vehicle, with next to no torque."""
    return replace(point(rate, torque, error=1e-4), stop=600.0)


def test_long_holds_at_rest_in_a_current_do_not_outweigh_the_turns() -> None:
    turns = [point(rate, truth(rate) + off, error=2e-3) for rate, off in zip(TURNS, (9, -8, 7, -9, 8, -7), strict=True)]
    rests = [at_rest(rate, torque) for rate, torque in ((0.09, -2.0), (0.1, -1.0), (-0.08, 1.5), (-0.09, 2.0))]
    estimate = fit_drag([*turns, *rests]).estimate
    for name, true in (("quadratic_drag", 3532.0), ("linear_drag", 132.0)):
        assert abs(estimate.value(name) - true) < 2.0 * estimate.standard_error(name)
    # A rate of 0.2 rad/s takes 168 N m.
    assert estimate.value("quadratic_drag") * 0.04 + estimate.value("linear_drag") * 0.2 == pytest.approx(168, rel=0.1)
    assert any("4 of 10 holds" in text for text in estimate.warnings)


RATES = (-0.2, -0.1, 0.05, 0.12, 0.2, 0.25)
BOTH = np.array([True, True])


def balance(torque: FloatArray | None = None) -> TorqueBalance:
    made = TorqueBalance.of([point(rate, 0.0) for rate in RATES], YAW, BOTH)
    return made if torque is None else replace(made, torque=torque)


def drag(rates: tuple[float, ...], quadratic: float = 3000.0, linear: float = 100.0) -> FloatArray:
    return np.array([quadratic * abs(rate) * rate + linear * rate for rate in rates])


def test_exact_torques_give_exact_drag_and_leave_one_out_residuals() -> None:
    exact = balance(drag(RATES))
    assert exact.solve().values == pytest.approx([3000.0, 100.0])
    left_out = exact.leave_one_out()
    assert left_out[:, 0] == pytest.approx(3000.0)
    assert left_out[:, 2] == pytest.approx(0.0, abs=1e-9)


def test_an_unknown_that_is_not_free_stays_zero() -> None:
    solution = replace(balance(drag(RATES, linear=0.0)), free=np.array([True, False])).solve()
    assert solution.values == pytest.approx([3000.0, 0.0])
    assert solution.covariance[1, 1] == 0.0


def test_one_speed_both_ways_does_not_distinguish_the_drags() -> None:
    assert balance().is_determined
    assert not TorqueBalance.of([point(rate, 0.0) for rate in (-0.2, 0.2)], YAW, BOTH).is_determined


def test_a_known_error_sets_the_scale_unless_the_scatter_is_larger() -> None:
    off = drag(RATES) + np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    large, small = (balance(off).with_error(np.full(len(RATES), size)).solve() for size in (10.0, 0.01))
    assert large.degrees_of_freedom == np.inf
    assert small.degrees_of_freedom == 4.0
    # With an error that is too small the scatter alone counts, as where none is known.
    assert small.covariance == pytest.approx(balance(off).solve().covariance)
    assert np.sqrt(large.covariance[0, 0]) > np.sqrt(small.covariance[0, 0])


def test_variance_between_holds_does_not_depend_on_their_length() -> None:
    points = [point(rate, 0.0, error=1e-3) for rate in RATES]
    points[2] = replace(points[2], stop=points[2].start + 100.0 * points[2].duration)
    off = drag(RATES) + np.array([8.0, -8.0, 8.0, -8.0, 8.0, -8.0])
    errors = pooled_errors(balance(off), points).error
    assert errors.min() > 0.5 * errors.max()
    quiet = pooled_errors(balance(drag(RATES)), points).error
    assert quiet.min() < 0.2 * quiet.max()


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_long_run_variance_of_an_autoregression(memory: float) -> None:
    rng = np.random.default_rng()
    estimates = []
    for _ in range(200):
        noise = rng.normal(size=400)
        noise[0] /= np.sqrt(1 - memory**2)
        values = signal.lfilter([1.0], [1.0, -memory], noise)
        estimates.append(long_run_variance(values - values.mean()))
    expected = 1.0 / (1.0 - memory) ** 2
    assert np.mean(estimates) == pytest.approx(expected, rel=0.15)  # first-order bias at n = 400 is a few percent


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
@pytest.mark.parametrize("memory", [0.1, slow(1.0), 10.0])
@pytest.mark.parametrize("count", [4, slow(5), 8, slow(20)])
def test_three_standard_errors_hold_at_any_number_of_holds(count: int, memory: float, *, one_way: bool) -> None:
    found = answers(count, memory, one_way=one_way)
    assert len(found) >= (DRAWS // 10 if count < 8 else DRAWS // 2)
    off = [max(abs(one.value(name) - TRUTH[name]) / one.standard_error(name) for name in NAMES) > 3.0 for one in found]
    # One in a hundred is expected of each drag; more than four have a probability of 1 in 300.
    assert sum(off) <= 4


@pytest.mark.slow
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


@pytest.mark.slow
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
