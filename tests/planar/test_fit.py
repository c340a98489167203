"""Fits recover the truth of vehicles that scipy simulates, and refuse what the sensors leave open."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.effects import effect_named
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.maximum_likelihood import fit_likelihood
from rovid.model.bound_effects import BoundEffect
from rovid.planar import fit, free_runs
from rovid.planar.coordinates import PlanarCoordinates
from rovid.planar.dataset import PlanarData
from rovid.planar.effect_fits import _with_stall
from rovid.planar.fit import PlanarFit, _shown_latency, fit_base, fit_planar, most_latencies, planar_result, refined
from rovid.planar.free_runs import (
    FreeRuns,
    better_simulating,
    correlation_time,
    fit_free_runs,
    free_run_r2,
    simulate_planar,
)
from rovid.planar.likelihood import PlanarLikelihood
from rovid.planar.model import BASE_NAMES, PlanarModel, RudderModel
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.regression import _bounded
from rovid.planar.start_values import planar_sizes, start_values
from rovid.planar.trial_simulation import simulate_planar_trials
from rovid.planar.uncertainty import total_covariance
from rovid.trial.preprocessing import prepare_trials
from rovid.trial.vehicle import Rudder
from tests.planar.vehicles import Truth, box_rov, campaign, torpedo, usv

# Standard errors: the largest of a dozen independent normal deviates exceeds 3.5 in 1 of 180 fits; seeds are fixed.
SIGMAS = 3.5


def deviations(fitted: PlanarFit, truth: Truth) -> dict[str, float]:
    """Deviation of each estimated parameter from the truth in standard errors."""
    true = dict(zip(BASE_NAMES, truth.base, strict=True))
    if truth.rudder is not None:
        true |= {"rudder.rudder.lift": truth.rudder[1], "rudder.rudder.resistance": truth.resistance}
    if math.isfinite(truth.stall):
        true["rudder.rudder.stall"] = truth.stall
    if any(truth.current):
        north, east = truth.current
        true |= {"current.speed": math.hypot(north, east), "current.direction": math.atan2(east, north)}
    estimate = fitted.estimate
    known = [name for name in true if name not in estimate.refused]
    return {name: (estimate.value(name) - true[name]) / estimate.standard_error(name) for name in known}


@pytest.mark.parametrize(
    ("truth", "hold"),
    [(box_rov(3), 6.0), (torpedo(3, resistance=0.2), 8.0), (torpedo(3, stall=0.3), 8.0)],
    ids=["box ROV with DVL", "torpedo with a fin of little resistance", "torpedo with a rudder that stalls early"],
)
@pytest.mark.slow
def test_the_truth_is_within_the_errors(truth: Truth, hold: float) -> None:
    fitted = fit_planar(campaign(truth, runs=2, levels=20, hold=hold, seed=3))
    found = deviations(fitted, truth)
    assert {"surge.inertia", "sway.inertia", "yaw.inertia"} <= found.keys()
    assert max(map(abs, found.values())) < SIGMAS
    assert fitted.white


@pytest.mark.slow
def test_a_current_is_found_from_positions() -> None:
    truth = usv(4, current=(0.2, -0.2))
    data = campaign(truth, runs=2, levels=20, hold=10.0, seed=4)
    fitted = fit_planar(data, (effect_named("current"),))
    found = deviations(fitted, truth)
    assert {"surge.inertia", "sway.inertia", "current.speed", "current.direction"} <= found.keys()
    assert max(map(abs, found.values())) < SIGMAS


# Sensors that measure no sway: compass and speed log.
SPEED_LOG = {"heading": (0.005, 0.1), "surge_velocity": (0.01, 0.2)}


def test_turns_tell_the_size_of_a_sway_that_is_not_measured() -> None:
    truth = usv(4, noise=SPEED_LOG, disturbance=(0.4, 0.2, 0.4))
    data = campaign(truth, runs=1, levels=20, hold=10.0, seed=4)
    start = min(start_values(data, with_current=False), key=lambda one: one.residual)
    sway = simulate_planar(PlanarModel(base=np.array(truth.base)), data.runs[0]).through_water[:, 1]
    # The guessed hulls are a factor of 3 apart in their time constants, and of 1.7 in their inertia.
    assert abs(math.log(start.speed[1] / np.sqrt(np.mean(sway**2)))) < 0.5 * math.log(3.0 * 1.7)
    assert start.model.base[:3] == pytest.approx(truth.base[:3], rel=0.5)


def test_a_hull_that_nothing_turns_starts_with_a_yaw_inertia() -> None:
    truth = usv(4, noise=SPEED_LOG, levers=((90.0, 0.0, 0.0),))
    for start in start_values(campaign(truth, runs=1, levels=10, hold=10.0, seed=4), with_current=False):
        assert start.model.base[2] > 1.0


@pytest.mark.slow
def test_a_sway_that_is_not_measured_follows_from_the_turns() -> None:
    truth = usv(4, noise=SPEED_LOG)
    fitted = fit_planar(campaign(truth, runs=3, levels=20, hold=10.0, seed=4))
    found = deviations(fitted, truth)
    assert {"surge.inertia", "sway.inertia", "yaw.inertia"} <= found.keys()
    assert max(map(abs, found.values())) < SIGMAS
    assert fitted.white


def test_a_bounded_regression_is_the_exact_one() -> None:
    rng = np.random.default_rng(3)
    columns = list(rng.normal(size=(5, 200)) * np.array([[1.0], [1e3], [1e-3], [1.0], [10.0]]))
    # The second and the last coefficient are negative without bounds.
    target = 2.0 * columns[0] - 1e-3 * columns[1] - 4e3 * columns[2] - 0.3 * columns[4] + rng.normal(size=200)
    found, left = _bounded(columns, target, free=(2,))
    low = np.array([0.0, 0.0, -np.inf, 0.0, 0.0])
    expected = lsq_linear(np.column_stack(columns), target, (low, np.full(5, np.inf)), method="bvls", tol=1e-14)
    assert found == pytest.approx(expected.x, rel=1e-6, abs=1e-9)
    assert left == pytest.approx(2.0 * expected.cost / float(target @ target), rel=1e-9)
    assert found[2] < -3e3
    found, left = _bounded(columns, target, (2,), 3.0)
    low[0] = 3.0
    expected = lsq_linear(np.column_stack(columns), target, (low, np.full(5, np.inf)), method="bvls", tol=1e-14)
    assert found == pytest.approx(expected.x, rel=1e-6, abs=1e-9)
    assert left == pytest.approx(2.0 * expected.cost / float(target @ target), rel=1e-9)


def test_the_mass_gives_a_start_where_noise_hides_the_accelerations() -> None:
    """Positions once in a second, with an error of as much as the vehicle moves in that time."""
    noise = {"heading": (1e-3, 0.1), "north": (0.5, 1.0), "east": (0.5, 1.0)}
    data = campaign(truth := box_rov(3, noise=noise), runs=2, levels=20, hold=4.0, seed=3)
    mass = 0.8 * min(truth.base[:2])
    starts = start_values(replace(data, vehicle=replace(data.vehicle, mass=mass)), with_current=False)
    plain, heavy = ([one for one in starts if one.is_heavy == wanted] for wanted in (False, True))
    assert len(plain) == len(heavy)
    assert min(one.model.base[:2].min() for one in plain) < 0.5 * mass
    assert min(one.model.base[:2].min() for one in heavy) >= mass


def test_the_mass_gives_the_sizes_where_its_start_simulates_best(
    small: tuple[PlanarData, PlanarOptimum], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sizes of a start with nearly no inertia: a tanker's fit had no answer within 400 s of processor time."""
    data, best = small
    base = np.where(np.arange(10) < 2, 0.7, 1.0) * best.model.base
    start = replace(start_values(data, with_current=False)[0], model=best.model, residual=0.5, is_heavy=True)
    light = replace(start, model=replace(best.model, base=base), residual=0.1, is_heavy=False)
    monkeypatch.setattr(fit, "start_values", lambda *_, **__: [light, start])
    monkeypatch.setattr(PlanarOptimum, "fit", classmethod(lambda cls, likelihood, x, *_: cls(likelihood, x, 0.0)))
    found = fit_base(data, with_current=True).coordinates.sizes.inertia
    assert found[:2] == pytest.approx(best.model.base[:2])


@pytest.mark.slow
def test_a_fit_from_far_away_needs_few_jacobians(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each Jacobian takes a pass for each parameter. Steps with new ones alone took 25, and ended 24 nats higher."""
    data = campaign(torpedo(3, stall=0.3), runs=2, levels=20, hold=8.0, seed=3)
    count, plain = [0], PlanarLikelihood.jacobian

    def counted(*given: Any) -> Any:
        count[0] += 1
        return plain(*given)

    monkeypatch.setattr(PlanarLikelihood, "jacobian", counted)
    assert fit_base(data).value < -30740.0
    assert count[0] <= 22


def heading_alone(*pushed: tuple[float, float, float]) -> PlanarData:
    truth = Truth(
        base=(30.0, 40.0, 4.0, 0.0, 8.0, 12.0, 1.0, 20.0, 30.0, 2.0),
        levers=((0.0, 0.0, 3.0), *pushed),
        noise={"heading": (0.005, 0.05)},
        disturbance=(0.0, 0.0, 0.03),
    )
    return campaign(truth, runs=2, levels=8, hold=6.0, seed=5)


def test_heading_alone_gives_the_yaw_model() -> None:
    data = heading_alone()
    fitted = fit_planar(data)
    vehicle = replace(data.vehicle, planar=False)
    one_axis = fit_likelihood(prepare_trials([run.trial for run in data.runs], vehicle).items, vehicle).estimate
    for name in ("inertia", "linear_drag", "quadratic_drag"):
        difference = fitted.estimate.value(f"yaw.{name}") - one_axis.value(name)
        assert abs(difference) < one_axis.standard_error(name)
    others = [name for name in BASE_NAMES if not name.startswith("yaw.")]
    assert set(others) <= set(fitted.estimate.refused)


def test_heading_alone_of_a_vehicle_that_drifts_has_the_errors_of_yaw_alone() -> None:
    """The Munk moment turns it, and nothing measures the drift."""
    data = heading_alone((20.0, 0.0, 0.0), (0.0, 20.0, 0.0))
    fitted = fit_base(data)
    narrow, estimate = total_covariance(fitted), planar_result(data, fitted).estimate
    wider = estimate.covariance - narrow
    own = fit_likelihood(prepare_trials([run.trial for run in data.runs], data.vehicle).items, data.vehicle).estimate
    for name in ("inertia", "linear_drag", "quadratic_drag"):
        at = estimate.names.index(f"yaw.{name}")
        assert wider[at, at] >= (1.0 - 1e-9) * own.standard_error(name) ** 2
    assert any(text.startswith("Thrusters push ahead") for text in estimate.warnings)


@pytest.mark.slow
def test_straight_runs_leave_sway_and_yaw_open() -> None:
    """Nothing turns the vehicle or pushes it sideways, and equal masses leave no Munk moment."""
    truth = Truth(
        base=(30.0, 30.0, 4.0, 0.0, 8.0, 12.0, 1.0, 20.0, 30.0, 2.0),
        levers=((20.0, 0.0, 0.0),),
        noise={"heading": (0.005, 0.05), "surge_velocity": (0.01, 0.2), "sway_velocity": (0.01, 0.2)},
    )
    fitted = fit_planar(campaign(truth, runs=2, levels=15, hold=6.0, seed=6))
    refused = set(fitted.estimate.refused)
    assert {"sway.inertia", "yaw.inertia", "sway.linear_drag", "yaw.linear_drag"} <= refused
    assert {"surge.inertia", "surge.linear_drag", "surge.quadratic_drag"}.isdisjoint(refused)
    assert fitted.undetermined
    assert np.max(np.abs(list(deviations(fitted, truth).values()))) < SIGMAS


def test_a_fit_that_diverges_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def diverged(likelihood: PlanarLikelihood, x: FloatArray) -> Innovations:
        count = int(likelihood.grid.used.sum())
        return Innovations(np.full(count, np.nan * x[0]), np.ones(count))

    monkeypatch.setattr(PlanarLikelihood, "evaluate", diverged)
    with pytest.raises(DataError, match="diverged"):
        fit_planar(campaign(box_rov(3), runs=1, levels=6, hold=4.0, seed=2))


@pytest.mark.slow
def test_a_fit_of_free_runs_recovers_a_torpedo_from_far() -> None:
    truth = torpedo(3)
    data = campaign(truth, runs=2, levels=12, hold=8.0, seed=4)
    base = fit_base(data)
    scale = np.where(np.arange(len(base.x)) < 3, 0.3, 0.0)
    away = PlanarOptimum(base.likelihood, base.coordinates.projected(base.x + scale), base.value)
    best = fit_free_runs(away, data)
    fitted = planar_result(data, best)
    assert fitted.multi_step
    # Where two criteria disagree, the difference is one standard error of the mass at least.
    apart = planar_result(data, replace(best, likeliest=1.2 * fitted.model.values))
    error = apart.estimate.standard_error("surge.inertia")
    assert error > 0.2 * fitted.model.base[0] > 5.0 * fitted.estimate.standard_error("surge.inertia")
    # Smoothing and the noise at the start of each simulation bias this fit by some percent.
    assert fitted.model.base[:2] == pytest.approx(truth.base[:2], rel=0.1)
    assert min(fitted.free_run_r2.values()) > 0.98


def test_the_true_model_simulates_what_a_slow_gps_measures_in_a_current() -> None:
    """The kernel is as wide as the vehicle's time constants: measured and simulated speeds both pass through it."""
    quiet = {"heading": (0.002, 0.1), "north": (0.03, 1.0), "east": (0.03, 1.0)}
    truth = usv(4, current=(0.2, -0.2), noise=quiet, disturbance=(0.0, 0.0, 0.0))
    data = campaign(truth, runs=2, levels=20, hold=10.0, seed=4)
    current = BoundEffect(effect_named("current"), np.array([math.hypot(0.2, 0.2), -math.pi / 4.0]))
    model = PlanarModel(base=np.array(truth.base), effects=(current,))
    assert min(free_run_r2(model, data).values()) > 0.999
    runs = FreeRuns.of(data, planar_sizes(data, start_values(data, with_current=True)[0]))
    assert runs is not None
    # Velocities smoothed in the earth frame, or simulations that are not smoothed, are off by 0.14 to 0.28.
    errors = runs.errors(model).error.reshape(-1, 3) / runs.usual
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 0.07


def test_slow_positions_do_not_blur_the_speeds_of_a_fast_log() -> None:
    """A log of speeds at 10 Hz beside a position every 4 s."""
    fast, slow = {"heading": 0.002, "surge_velocity": 0.005, "sway_velocity": 0.005}, {"north": 0.05, "east": 0.05}
    noise = {name: (one, 0.1) for name, one in fast.items()} | {name: (one, 4.0) for name, one in slow.items()}
    truth = box_rov(3, noise=noise, disturbance=(0.0, 0.0, 0.0))
    data = campaign(truth, runs=1, levels=15, hold=4.0, seed=2)
    # Regressions over intervals of the positions leave a quarter of the forces, and half of the inertia.
    start = min(start_values(data, with_current=False), key=lambda one: one.residual)
    assert start.residual < 0.01
    assert start.model.base[:3] == pytest.approx(truth.base[:3], rel=0.1)
    (found,) = simulate_planar_trials(PlanarModel(base=np.array(truth.base)), data)
    error, track = found.heading_errors[10.0], found.track_errors[10.0]
    # A kernel of two such intervals leaves no restart in this run, and errors of 2.6 rad in longer ones.
    assert error is not None
    assert error < 0.01
    # The noise of two fixes is 0.1 m. Restarts on straight lines between fixes have errors of 0.74 m.
    assert track is not None
    assert track < 0.2


def test_correlated_errors_count_as_fewer() -> None:
    """An autoregression of first order with the coefficient a has a correlation time of (1 + a)/(1 - a) samples."""
    rng, a = np.random.default_rng(1), 0.8
    errors = np.zeros((40_000, 2))
    for k, white in enumerate(rng.normal(size=(len(errors) - 1, 2)), start=1):
        errors[k] = a * errors[k - 1] + white
    # Bartlett's formula: the sum over some 50 lags scatters by about 6 %.
    assert correlation_time([errors[:25_000], errors[25_000:]]) == pytest.approx((1.0 + a) / (1.0 - a), rel=0.25)
    assert correlation_time([rng.normal(size=(20_000, 1))]) == pytest.approx(1.0, abs=0.1)


def test_a_position_may_be_later_than_the_turn_is_fast() -> None:
    # A USBL that is 0.3 s late, of a vehicle that turns within 0.2 s, is no error of the model.
    yaw, speed, position = most_latencies(np.array([3.0, 1.5, 0.2]))[[1, 2, 4]]
    assert (yaw, speed, position) == pytest.approx((0.12, 0.9, 0.9))
    assert most_latencies(np.array([20.0, 20.0, 20.0]))[[1, 2, 4]].tolist() == [1.0, 1.0, 5.0]


def test_a_latency_that_does_not_show_widens_the_errors(small: tuple[PlanarData, PlanarOptimum]) -> None:
    """The readings are on time here. The errors contain those of a latency that may be there."""
    data, base = small
    late = refined(base, data)
    assert not _shown_latency(late)
    held = late.likelihood.with_coordinates(late.coordinates.on_time([True]))
    on_time = PlanarOptimum(held, late.x, late.value)
    larger = np.sqrt(np.diag(late.covariance) / np.diag(on_time.covariance))
    assert larger[:2].min() > 1.02


def test_a_stall_angle_is_a_parameter_where_rovid_toml_gives_none() -> None:
    data = campaign(torpedo(3), runs=1, levels=4, hold=8.0, seed=3)
    start = min(start_values(data, with_current=False), key=lambda one: one.residual)
    coordinates = PlanarCoordinates.of(start.model, planar_sizes(data, start), data.sensors, yaw_only=False)
    x = coordinates.initial(start.model, ())
    found, longer, (place,) = coordinates.stalling(x, [0])
    assert found.model(longer).value("rudder.rudder.stall") == start.model.rudders[0].stall
    np.testing.assert_allclose(found.values(longer)[: place + 1], [*coordinates.values(x), longer[place]])
    longer[place] = 2.0
    assert found.projected(longer)[place] < 1.1  # 60 deg


def test_a_model_of_a_ship_has_no_stall_angle_of_its_rudder() -> None:
    rudder = RudderModel(name="helm", position=(-1.5, 0.0), straightening=0.5)
    likelihood = SimpleNamespace(grid=SimpleNamespace(yaw_only=False))
    best: Any = SimpleNamespace(coordinates=SimpleNamespace(rudders=(rudder,)), likelihood=likelihood)
    data: Any = SimpleNamespace(actuators=SimpleNamespace(rudders=(Rudder(position=(-1.5, 0.0)),)))
    assert _with_stall(best, data) is best


@pytest.mark.parametrize(
    ("white", "limited", "r2", "expected"),
    [(False, True, 0.8, True), (True, True, 0.8, False), (False, False, 0.8, False), (False, True, 0.95, False)],
)
def test_a_model_misses_much_where_likelihood_and_simulations_fail(
    white: bool, limited: bool, r2: float, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(free_runs, "free_run_r2", lambda *_: {"surge": 0.99, "yaw": r2})
    best: Any = SimpleNamespace(is_white=white, limited=np.array([False, limited]), model=None)
    data: Any = None
    assert free_runs.misses_much(best, data) is expected


def test_times_of_effects_follow_the_yaw_of_the_fitted_model(small: tuple[PlanarData, PlanarOptimum]) -> None:
    """The regression at the start of a tanker had no damping of yaw: a true current had to change more slowly."""
    coordinates, model = small[1].coordinates, small[1].model
    rate = coordinates.sizes.speed[2]
    damping = model.base[6] + 2.0 * model.base[9] * rate
    scale = model.base[1] / (model.base[1] * model.base[2] - model.base[3] ** 2)
    undamped = replace(model, base=np.where(np.isin(np.arange(10), (3, 6, 9)), 0.0, model.base))
    rudder = RudderModel(name="rudder", position=(-0.1, 0.0), stall=0.6, lift=2000.0, slipstream=0.0)
    steered = coordinates.with_time_of(replace(undamped, rudders=(rudder,))).sizes.effects.time
    assert coordinates.with_time_of(model).sizes.effects.time == pytest.approx(1.0 / (scale * damping), rel=0.3)
    assert coordinates.with_time_of(undamped).sizes.effects.time == coordinates.sizes.effects.time
    # The rudder's lift by its speed across, of an arm of 0.1 m, at the usual speed ahead.
    speed = coordinates.sizes.speed[0]
    assert steered == pytest.approx(model.base[2] / (2000.0 * 0.1**2 * speed), rel=0.3)


def test_a_current_that_changes_more_slowly_than_the_logs_show_is_at_no_bound() -> None:
    effect = effect_named("current:wandering")
    time = effect.parameters[3]
    values = np.array([0.3, 0.5, 0.1, time.high])
    best = PlanarOptimum.__new__(PlanarOptimum)
    object.__setattr__(best, "x", values)
    place: Any = lambda _: slice(0, 4)  # noqa: E731 - in place of the method
    object.__setattr__(best, "place", place)
    assert not best.is_at_bound(effect)
    values[3] = time.low
    assert best.is_at_bound(effect)


def test_what_an_inertia_lacks_of_the_mass_is_part_of_its_error(small: tuple[PlanarData, PlanarOptimum]) -> None:
    data, best = small
    plain = planar_result(data, best).estimate
    mass = 1.08 * plain.value("surge.inertia")
    heavy = planar_result(replace(data, vehicle=replace(data.vehicle, mass=mass)), best).estimate
    before, after = (one.standard_error("surge.inertia") for one in (plain, heavy))
    assert after == pytest.approx(np.hypot(before, mass - plain.value("surge.inertia")))
    assert before < 0.2 * after
    assert heavy.standard_error("sway.inertia") >= plain.standard_error("sway.inertia")


def test_results_of_guessed_arms_are_placeholders(small: tuple[PlanarData, PlanarOptimum]) -> None:
    data, base = small
    thrusters = tuple(replace(one, arm_guessed=True) for one in data.vehicle.thrusters)
    guessed = replace(data, vehicle=replace(data.vehicle, thrusters=thrusters))
    assert planar_result(guessed, base).estimate.is_placeholder("yaw.inertia")
    assert not planar_result(data, base).estimate.is_placeholder("yaw.inertia")


def test_rough_water_is_no_error_of_a_model_with_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """Free-running simulations do not follow a large disturbance: they lost the cause, and gave wrong parameters."""
    data = campaign(box_rov(3, disturbance=(0.72, 0.72, 0.144), memory=2.0), runs=2, levels=6, hold=4.0, seed=7)
    plain = fit_base(data)
    extended = plain.with_effect(effect_named("bias_torque:planar"))
    assert extended.limited.all()
    # A campaign of this length hardly shows how poor the simulations are.
    monkeypatch.setattr(free_runs, "misses_much", lambda *_: True)
    monkeypatch.setattr(free_runs, "fit_free_runs", lambda best, _: best)
    rough = better_simulating(extended, data)
    assert rough.is_white
    assert not rough.limited.any()
    assert rough.value < extended.value
    # Without effects a larger disturbance may hide what the model misses; a current that wanders hides it as well.
    assert better_simulating(plain, data) is plain
    wandering = replace(extended, likelihood=replace(extended.likelihood, coordinates=replace(
        extended.coordinates, effects=(effect_named("current:wandering"),))))  # fmt: skip
    assert better_simulating(wandering, data) is wandering
