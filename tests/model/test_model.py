"""The model, its heading sensor and the names of its parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from rovid.core.errors import ConfigError
from rovid.effects import TERM_EFFECTS, effect_named
from rovid.effects.base import TERM_PARAMETERS
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.multi_step import MultiStepData, prediction_errors
from rovid.model.bound_effects import BoundEffect, pack_terms
from rovid.model.model import HeadingSensor, Model
from rovid.model.parameter_names import base_names, effect_ids, unit_of, without_form
from rovid.model.simulation import simulate_runs
from rovid.model.torque_input import TorqueInput
from rovid.trial.axis import AXES, YAW
from rovid.trial.rates import compute_rates
from tests import synthetic
from tests.synthetic import clock


def test_names_and_values_of_parameters_correspond() -> None:
    effects = (effect_named("thruster_lag"), effect_named("added_mass_memory"))
    model = Model(
        inertia=5.0,
        quadratic_drag=2.0,
        linear_drag=0.5,
        effects=effects,
        effect_values=(0.2, 1.5, 4.0),
        axis=AXES["pitch"],
        restoring_values=(30.0, 0.1),
    )
    named = dict(zip(model.names, model.values.tolist(), strict=True))
    assert named["inertia"] == 5.0
    assert [named[f"{e.key}.{p.name}"] for e in effects for p in e.parameters] == [0.2, 1.5, 4.0]
    assert model.natural_frequency == pytest.approx(np.sqrt(30.0 / 5.0))
    assert model.low_frequency_inertia > model.inertia


@pytest.mark.parametrize("stiffness", [0.0, 40.0])
def test_the_rate_under_a_disturbance_agrees_with_the_lyapunov_equation(stiffness: float) -> None:
    inertia, rate, memory = 5.0, 0.3, 2.5
    model = Model(
        inertia=inertia, quadratic_drag=3.0, linear_drag=1.2, axis=AXES["pitch"], restoring_values=(stiffness, 0.0)
    )
    damping = 2.0 * 3.0 * rate + 1.2
    # Angle, rate, disturbance of unit variance. Without a stiffness the angle wanders, and has no say.
    motion = np.array([[0.0, 1.0, 0.0], [-stiffness, -damping, 1.0], [0.0, 0.0, -1.0 / memory]])
    motion[1] /= inertia
    driven = np.diag([0.0, 0.0, 2.0 / memory])
    at = slice(None) if stiffness else slice(1, None)
    spread = solve_continuous_lyapunov(motion[at, at], -driven[at, at])
    assert model.rate_std_per_torque(rate, memory) == pytest.approx(np.sqrt(spread[-2, -2]), rel=1e-9)


OFF = HeadingSensor((BoundEffect(effect_named("heading_deviation"), np.array([0.08, 0.5])),))
PLAIN = HeadingSensor((BoundEffect(effect_named("bias_torque"), np.array([20.0])),))


def test_the_measured_rate_is_the_derivative_of_the_measured_heading() -> None:
    time = clock(60.0, 5.0)
    true, rate = 0.15 * time, np.full(len(time), 0.15)
    measured, shown = OFF.to_measured(true, rate)
    assert shown == pytest.approx(np.gradient(measured, time), abs=1e-3 * 0.15)


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("heading_deviation", (0.08, 0.5)),
        ("heading_deviation:two_cycles", (0.3, -2.0)),
        ("heading_deviation:mixed", (0.4, 1.0, 0.25, 2.0)),
    ],
)
def test_to_true_inverts_to_measured(key: str, values: tuple[float, ...]) -> None:
    off = HeadingSensor((BoundEffect(effect_named(key), np.array(values)),))
    true = np.linspace(-20.0, 30.0, 5000)
    measured, gain = off.to_measured(true, np.ones(5000))
    measured[7] = np.nan
    found, told = off.to_true(measured)
    assert np.isnan(found[7])
    known = np.arange(5000) != 7
    assert found[known] == pytest.approx(true[known], abs=1e-8)
    assert told[known] == pytest.approx(gain[known], rel=1e-6)


def test_a_sensor_without_deviation_changes_nothing() -> None:
    heading, rate = np.linspace(0.0, 9.0, 50), np.linspace(-0.1, 0.2, 50)
    assert not PLAIN.deviates
    assert OFF.deviates
    assert np.array_equal(PLAIN.to_measured(heading, rate), (heading, rate))
    assert np.array_equal(PLAIN.to_true(heading), (heading, np.ones(50)))
    assert not PLAIN.deviation(heading).any()


@pytest.mark.parametrize("gyro", [False, True])
def test_a_gyro_has_no_deviation(*, gyro: bool) -> None:
    """The true model predicts both a logged rate and the derivative of a deviating heading."""
    deviation = effect_named("heading_deviation:two_cycles")
    model = replace(synthetic.ROSUB, effects=(deviation,), effect_values=(0.1, 0.5))
    time = clock(120.0)
    torque = 400.0 * np.sign(np.sin(2.0 * np.pi * time / 40.0))
    true = synthetic.run(time, torque)
    rate, angle = synthetic.ROSUB.simulate(true.trial, TorqueInput.held(torque))
    heading, _ = model.heading_sensor.to_measured(angle, rate)
    trial = synthetic.trial(time, torque, heading, rate=rate if gyro else None)
    run = replace(true, trial=trial, rates=compute_rates(trial, cutoff=1.0))
    (simulated,) = simulate_runs([run], model, synthetic.LOGGED)
    assert simulated.fit.r2 > 0.9999
    data = InnovationData([run], synthetic.LOGGED, synthetic.ROSUB)
    errors = prediction_errors(MultiStepData.from_data(data, synthetic.ROSUB), model)
    # Rounding by the filter and by the grid; the deviation is 0.1 rad.
    assert np.sqrt(np.mean(errors**2)) < 0.003


def test_a_self_righting_axis_has_a_stiffness() -> None:
    assert base_names(YAW) == ("inertia", "quadratic_drag", "linear_drag")
    assert "restoring_stiffness" in base_names(AXES["roll"])
    assert "net_buoyancy" in base_names(AXES["heave"])


@pytest.mark.parametrize(
    ("name", "axis", "unit"),
    [
        ("inertia", "yaw", "kg m^2"),
        ("inertia", "surge", "kg"),
        ("thruster_lag.time_constant", "surge", "s"),
        ("bias_torque.torque", "yaw", "N m"),
        ("bias_torque.torque", "heave", "N"),
        # A frequency counts radians along any axis.
        ("wave_torque.frequency", "heave", "rad/s"),
        ("restoring_stiffness", "roll", "N m/rad"),
    ],
)
def test_units_follow_the_axis(name: str, axis: str, unit: str) -> None:
    assert unit_of(name, AXES[axis]) == unit


def test_an_unknown_effect_has_no_unit() -> None:
    with pytest.raises(ConfigError, match="no effect 'thruster_lagg'"):
        unit_of("thruster_lagg.time_constant")


def test_effect_ids_from_parameter_names() -> None:
    names = ["inertia", "thruster_lag:command.time_constant", "wave_torque.amplitude", "wave_torque.frequency"]
    assert effect_ids(names) == ["thruster_lag:command", "wave_torque"]
    assert without_form(names[1]) == "thruster_lag.time_constant"
    assert without_form("inertia") == "inertia"


def acting(name: str, *numbers: float) -> BoundEffect:
    return BoundEffect(effect_named(name), np.array(numbers))


def test_terms_that_entrain_water_come_first_then_stateful_ones() -> None:
    drag, memory = acting("drag_curvature", 0.2), acting("added_mass_memory", 300.0, 4.0)
    swirl, delay = acting("entrained_swirl", 0.3, 20.0), acting("command_delay", 0.4)
    terms = pack_terms([drag, memory, delay, swirl], 0.5)
    assert [TERM_EFFECTS[kind].id for kind in terms.kinds] == ["entrained_swirl", "added_mass_memory", "drag_curvature"]
    assert (terms.entraining, terms.stateful) == (1, 2)
    assert terms.parameters[::TERM_PARAMETERS, 0].tolist() == [0.3, 300.0, 0.2]


def test_the_fastest_rate_is_at_least_that_of_the_motion() -> None:
    assert pack_terms([], 0.5).fastest == 0.5
    assert pack_terms([acting("tank_seiche", 0.1, 3.0, 0.05)], 0.5).fastest == 3.0
    assert pack_terms([acting("tank_seiche", 0.1, 0.2, 0.05)], 0.5).fastest == 0.5


def test_heavy_water_is_integrated_at_the_rate_of_motion_and_water_together() -> None:
    memory = acting("added_mass_memory", 9.0, 0.5)
    assert pack_terms([memory], 0.1, 3.0).fastest == pytest.approx((1.0 + 9.0 / 3.0) / 0.5)
