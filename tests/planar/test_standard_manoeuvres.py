"""Turning circles and zigzags of models with known measures, and in simulated runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

from rovid.core.array_types import FloatArray
from rovid.estimate.estimate import Estimate
from rovid.planar.dataset import PlanarData, planar_data
from rovid.planar.equations import accelerations
from rovid.planar.fit import PlanarFit
from rovid.planar.manoeuvres import ManoeuvreMeasure, Measures, with_errors
from rovid.planar.model import BASE_NAMES, PlanarModel, RudderModel
from rovid.planar.standard_manoeuvres import (
    SteeringSystem,
    model_manoeuvres,
    model_measures,
    run_manoeuvres,
    turning_curve,
)
from rovid.trial.trial import Campaign
from tests.planar.vehicles import Truth, campaign, simulate

# Equal inertias ahead and sideways: no Munk moment. Yaw is Nomoto's model with T = 30/15 s and K = 12/15 rad/s.
YAW_ALONE = np.array([60.0, 60.0, 30.0, 0.0, 40.0, 80.0, 15.0, 0.0, 0.0, 0.0])
SYSTEM = SteeringSystem(approach_speed=1.0, rudders=0, largest=12.0, side_force=0.0, slipstream=0.0)


def test_a_vehicle_whose_yaw_is_alone_has_nomotos_gain_and_time_constant() -> None:
    found = model_measures(PlanarModel(base=YAW_ALONE), SYSTEM)
    assert found["zigzag_20.T"].value == pytest.approx(2.0, rel=1e-3)
    assert found["zigzag_20.K"].value == pytest.approx(0.8, rel=1e-3)
    assert found["zigzag_20.K"].unit == "rad/s"
    # Heading K (t - T (1 - exp(-t/T))) at the first execute; then the rate r0 falls to zero in T ln(1 + r0/K).
    execute = brentq(lambda t: 0.8 * (t - 2.0 * (1.0 - np.exp(-0.5 * t))) - np.radians(20.0), 0.1, 10.0)
    assert found["zigzag_20.first_execute_time"].value == pytest.approx(execute, rel=1e-4)
    peak = 2.0 * np.log(2.0 - np.exp(-0.5 * execute))
    assert found["zigzag_20.first_overshoot_time"].value == pytest.approx(peak, rel=2e-3)
    assert found["circle_starboard.steady_yaw_rate"].value == pytest.approx(0.8, rel=1e-3)
    assert found["circle_port.steady_yaw_rate"].value == pytest.approx(-0.8, rel=1e-3)


def test_a_steady_turn_solves_the_equations() -> None:
    base = np.array([35.0, 62.0, 9.0, 3.0, 2.0, 20.0, 8.0, 5.0, 90.0, 20.0])
    rudder = RudderModel(name="rudder", position=(-0.9, 0.0), lift=25.0)
    model = PlanarModel(base=base, rudders=(rudder,))
    system = SteeringSystem(approach_speed=1.5, rudders=1, largest=0.2, side_force=0.0, slipstream=0.0)
    # A turn has 35 deg of rudder, whatever the runs have.
    order = np.radians(35.0)
    thrust = (2.0 + 5.0 * 1.5) * 1.5
    held = np.array([thrust, 0.0, 0.0, order, 0.0])

    def unbalanced(nu: FloatArray) -> FloatArray:
        return accelerations(model, nu, held, np.zeros(3))

    u, v, r = fsolve(unbalanced, np.array([1.2, -0.2, 0.3]))
    found = model_measures(model, system)
    # The last quarter of two turns is not entirely steady.
    assert found["circle_starboard.steady_diameter"].value == pytest.approx(2.0 * np.hypot(u, v) / r, rel=0.01)
    assert found["circle_starboard.steady_drift_angle"].value == pytest.approx(np.arctan2(-v, u), rel=0.02)
    curve = turning_curve(model, system, length=2.0, points=3)
    assert curve[-1] == pytest.approx([order, r * 2.0 / np.hypot(u, v)], rel=1e-3)
    assert curve[1, 1] == pytest.approx(0.0, abs=1e-9)


def data_of(truth: Truth, commands: FloatArray, hold: float) -> PlanarData:
    """One run under given commands, with the readings of a campaign."""
    given = campaign(truth, runs=1, levels=len(commands), hold=hold, seed=3)
    states = simulate(truth, commands, hold, np.zeros(6), 3)
    run = given.runs[0].trial
    readings = {}
    for name, column in (("surge_velocity", 1), ("sway_velocity", 2)):
        time = run.readings[name].time
        readings[name] = replace(run.readings[name], values=np.interp(time, run.time, states[:, column]))
    held = np.repeat(commands, round(hold / 0.05), axis=0)
    trial = replace(
        run, position=states[:, 0], commands=np.vstack((held, held[-1:])), readings=readings, name="turns.csv"
    )
    return planar_data(Campaign(trials=(trial,), sources=()), given.vehicle)


NOISE = {"heading": (0.0, 0.05), "surge_velocity": (0.0, 0.2), "sway_velocity": (0.0, 0.2)}
TORPEDO = Truth(
    base=(35.0, 62.0, 9.0, 3.0, 2.0, 20.0, 8.0, 5.0, 90.0, 20.0),
    levers=((14.0, 0.0, 0.0),),
    rudder=(-0.9, 25.0),
    noise=NOISE,
)


def test_a_turning_circle_in_a_run_is_found_and_measured() -> None:
    commands = np.column_stack((np.ones(10), [0.0, 0.0, *[0.4] * 8]))
    data = data_of(TORPEDO, commands, 5.0)
    rudder = RudderModel(name="rudder", position=(-0.9, 0.0), lift=25.0, stall=1.5)
    model = PlanarModel(base=np.array(TORPEDO.base), rudders=(rudder,))
    (found,) = run_manoeuvres(model, data)
    assert (found.run, found.kind) == ("turns.csv", "turning_circle")
    assert found.steering == pytest.approx(0.4)
    assert found.begin == pytest.approx(10.0, abs=0.5)  # smoothed over two intervals of 0.2 s
    for name in ("advance", "tactical_diameter", "steady_diameter"):
        # The smoothed velocities of the run cut its corners.
        assert found.measured[name].value == pytest.approx(found.simulated[name].value, rel=0.05)


def test_the_rudder_moves_at_its_rate_in_the_runs() -> None:
    system = SteeringSystem(approach_speed=1.0, rudders=1, largest=0.2, side_force=0.0, slipstream=0.0, rudder_rate=0.1)
    time = np.array([0.0, 1.0, 2.0, 5.0])
    np.testing.assert_allclose(system.movement(-0.2, 0.2, time), [-0.2, -0.1, 0.0, 0.2])
    np.testing.assert_allclose(system.movement(0.1, -0.2, time), [0.1, 0.0, -0.1, -0.2])
    data = data_of(TORPEDO, np.column_stack((np.ones(4), [0.0, 0.4, -0.4, 0.4])), 5.0)
    run = data.runs[0].trial
    held = run.commands.copy()
    held[:, 1] = np.interp(run.time, [0.0, 5.0, 9.0, 12.0, 14.0], [0.0, 0.0, 0.2, 0.2, 0.1])
    slow = planar_data(Campaign(trials=(replace(run, commands=held),), sources=()), data.vehicle)
    model = PlanarModel(base=np.array(TORPEDO.base), rudders=(RudderModel(name="rudder", position=(-0.9, 0.0)),))
    assert SteeringSystem.of(slow, model).rudder_rate == pytest.approx(0.05, rel=1e-6)
    # Read once a second, in rows of 0.2 s.
    held[:, 1] = np.repeat(held[::5, 1], 5)[: len(held)]
    seldom = planar_data(Campaign(trials=(replace(run, commands=held),), sources=()), data.vehicle)
    assert SteeringSystem.of(seldom, model).rudder_rate == pytest.approx(0.05, rel=1e-6)
    # Orders jump, 5 s one after the other.
    jump = 0.8 / float(np.diff(run.time).max())
    assert SteeringSystem.of(data, model).rudder_rate == pytest.approx(jump, rel=1e-6)


def test_errors_do_not_depend_on_units() -> None:
    def measure(values: FloatArray) -> Measures:
        return {"sum": ManoeuvreMeasure(value=float(1e-6 * values[0] + 1e5 * values[1]), unit="1")}

    # Standard deviations of 2e6 and 1e-5, correlation 0.5: both terms matter alike.
    covariance = np.array([[4e12, 10.0], [10.0, 1e-10]])
    (found,) = with_errors(measure, np.array([3e6, 2e-5]), covariance).values()
    assert found.standard_error == pytest.approx(np.sqrt(4.0 + 1.0 + 2.0), rel=1e-6)


def test_errors_follow_the_parameters_and_undetermined_ones_refuse_their_measures() -> None:
    covariance = np.zeros((10, 10))
    covariance[2, 2] = 0.3**2  # 1 % of the yaw inertia, and so of T
    data = data_of(
        Truth(base=tuple(YAW_ALONE.tolist()), levers=((40.0, 0.0, 0.0), (0.0, 0.0, 12.0)), noise=NOISE),
        np.array([[1.0, 0.0], [1.0, 1.0], [1.0, -1.0], [1.0, 0.0]]),
        5.0,
    )
    estimate = Estimate(
        names=BASE_NAMES, values=YAW_ALONE, covariance=covariance, method="test", samples=100, refused={}
    )
    fit = PlanarFit(
        model=PlanarModel(base=YAW_ALONE),
        estimate=estimate,
        log_likelihood=0.0,
        noise={},
        disturbance={},
        free_run_r2={},
    )
    found = model_manoeuvres(fit, data)
    assert found["circle_port.steering"].value == -1.0  # the largest torque, where there is no rudder
    assert found["zigzag_20.T"].standard_error == pytest.approx(0.02, rel=0.05)  # second order of the delta method
    # Two parameters that the runs determine only together leave the measures of their ratio known.
    both = np.zeros((10, 10))
    both[np.ix_((2, 6), (2, 6))] = np.outer(YAW_ALONE[[2, 6]], YAW_ALONE[[2, 6]])
    both[2, 2] += 0.3**2
    refused = {"yaw.inertia": "not excited", "yaw.linear_drag": "not excited"}
    together = model_manoeuvres(replace(fit, estimate=replace(estimate, covariance=both, refused=refused)), data)
    assert together["zigzag_20.T"].standard_error == pytest.approx(0.02, rel=0.05)
    assert "zigzag_20.K" not in together
    # No measurement depends on a parameter without a variance.
    open_ = replace(estimate, covariance=np.zeros((10, 10)), refused={"yaw.inertia": "not excited"})
    found = model_manoeuvres(replace(fit, estimate=open_), data)
    assert "zigzag_20.T" not in found
    assert "circle_starboard.steady_yaw_rate" in found
