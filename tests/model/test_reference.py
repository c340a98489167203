"""The compiled loops against the plain reference, for every effect of the catalogue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.effects import TERM_EFFECTS, Effect, effect_named
from rovid.effects.base import Term, WaveTorque
from rovid.model import reference
from rovid.model.bound_effects import BoundEffect, pack_terms
from rovid.model.kernels import ekf3_innovations, ekf5_innovations, predict_multi_step, simulate_effects
from rovid.model.model import Model
from rovid.model.reference import ExtendedKalmanFilter, Motion, Noise, ReferenceEquation
from rovid.model.torque_input import TorqueInput
from rovid.trial.axis import AXES
from tests.conftest import slow
from tests.effects.test_effects import EVERY, VEHICLE, logs, numbers
from tests.filters import Log, filter_one
from tests.synthetic import ROSUB

NOISE = Noise(disturbance=15.0, correlation_time=4.0, angle=1e-3, rate=2e-3)
# 20 s with channels and with commands of both signs.
TRIAL = logs()[0]
START = 0.4

# Other effects change the torque alone, as `test_actuator_model.py` tests, and not the equation: three stand for all.
IN_THE_EQUATION = (Term, WaveTorque)
TORQUES = {"thruster_lag", "thruster_lag:spin", "command_delay"}
each = pytest.mark.parametrize(
    "effect",
    [None, *(one if isinstance(one.acts, IN_THE_EQUATION) or one.key in TORQUES else slow(one) for one in EVERY)],
    ids=lambda effect: effect.key if effect else "none",
)


def modelled(effect: Effect | None) -> Model:
    if effect is None:
        return ROSUB
    return replace(ROSUB, effects=(effect,), effect_values=tuple(numbers(effect, start=True).tolist()))


def short(torque_input: TorqueInput, count: int) -> TorqueInput:
    return torque_input.mapped(lambda series: series[:count])


@each
def test_the_free_running_simulation(effect: Effect | None) -> None:
    model = modelled(effect)
    torque = model.torque_input(VEHICLE, TRIAL)
    equation = ReferenceEquation(model.body, model.bound_effects, START)
    wanted, _ = reference.simulate(equation, TRIAL.time, torque, Motion(0.0, 0.02, equation.at_rest()))
    inputs = torque.torque, torque.timing_moment, torque.effect_inputs
    states = np.zeros((1, 2 * len(model.terms.kinds)))
    found, _ = simulate_effects(
        torque.offsets, TRIAL.time, inputs, np.array([START]), np.array([[0.02, 0.0]]), states, model.body, model.terms
    )
    # Steps of half the shortest time constant are exact to 1e-4.
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-4 * np.abs(wanted).max())


@pytest.mark.parametrize("effect", TERM_EFFECTS, ids=lambda effect: effect.key)
def test_the_multi_step_prediction(effect: Effect) -> None:
    bound = BoundEffect(effect, numbers(effect, start=True))
    count, period = 60, 0.4
    body = ROSUB.body._replace(stiffness=50.0, trim=0.02)
    torque = np.where(np.arange(count) % 20 < 10, 150.0, -90.0)
    inputs = np.column_stack((0.2 * np.ones(count), 0.8 + 0.1 * np.sin(np.arange(count)), 0.05 * np.ones(count)))
    rate, angle, terms = np.full(count, 0.05), np.linspace(0.0, 1.2, count), pack_terms([bound], 0.0)
    restarts, ahead = np.array([3, 30]), np.array([25, 12])
    found = predict_multi_step(
        np.full(2, period),
        torque,
        inputs,
        rate,
        angle,
        np.zeros((count, 2)),
        restarts,
        ahead,
        np.full(2, START),
        body,
        terms,
    )
    equation = ReferenceEquation(body, [bound], START)
    for row, (first, steps) in enumerate(zip(restarts, ahead, strict=True)):
        held = TorqueInput.held(torque[first:], inputs[first:])
        initial = Motion(angle[first], rate[first], equation.at_rest())
        wanted = reference.predict(equation, period, held, initial, int(steps))
        # As above; friction that changes its sign within a step costs more.
        share = 3e-4 if effect.id == "coulomb_resistance" else 1e-4
        np.testing.assert_allclose(found[row, : steps + 1], wanted, rtol=0.0, atol=share * np.abs(wanted).max())


def measured(model: Model, torque: TorqueInput, time: FloatArray) -> FloatArray:
    """(n, 2) noisy angle and rate, with a gap in the angle and a rate that is measured at times."""
    rng = np.random.default_rng(7)
    equation = ReferenceEquation(model.body, model.bound_effects, START)
    rate, angle = reference.simulate(equation, time, torque, Motion(0.0, 0.02, equation.at_rest()))
    readings = np.column_stack((angle + START, rate)) + rng.normal(size=(len(time), 2)) * (NOISE.angle, NOISE.rate)
    readings[60:75, 0] = np.nan
    readings[np.arange(len(time)) % 30 > 15, 1] = np.nan
    return np.asarray(readings)


def compare_filters(model: Model, torque: TorqueInput, time: FloatArray, noise: Noise, share: float = 2e-3) -> None:
    readings = measured(model, torque, time)
    plain = ExtendedKalmanFilter(model, noise, START)
    wanted, wanted_variance = plain.innovations(time, torque, readings, (0.02, 0.01))
    kernel = ekf5_innovations if plain.size == 5 else ekf3_innovations
    log = Log(time=time, angle=readings[:, 0], rate=readings[:, 1], first=(0.02, 0.01), start=START)
    sizes = (noise.disturbance, noise.correlation_time, noise.angle, noise.rate)
    found, variance = filter_one(kernel, log, torque, model, sizes)
    known = np.isfinite(wanted)
    assert (np.isfinite(found) == known).all()
    # The kernels propagate the covariance by series over steps of 0.3 and 0.6 of the shortest time constant.
    np.testing.assert_allclose(variance[known], wanted_variance[known], rtol=share)
    np.testing.assert_allclose((found - wanted)[known] / np.sqrt(wanted_variance[known]), 0.0, atol=3.0 * share)


@each
def test_the_filter(effect: Effect | None) -> None:
    model, count = modelled(effect), 100
    compare_filters(model, short(model.torque_input(VEHICLE, TRIAL), count), TRIAL.time[:count], NOISE)


@pytest.mark.parametrize("wave", [None, (40.0, 0.9, 0.1), (40.0, 4.0, 0.02), (20.0, 2.0, 0.3)])
def test_the_filter_of_a_stiff_axis(wave: tuple[float, ...] | None) -> None:
    """A work-class vehicle in pitch."""
    model = Model(
        inertia=3500.0,
        quadratic_drag=0.0,
        linear_drag=600.0,
        axis=AXES["pitch"],
        restoring_values=(2550.0, 0.0),
        effects=() if wave is None else (effect_named("wave_torque"),),
        effect_values=() if wave is None else wave,
    )
    time = np.arange(0.0, 30.0, 0.2)
    # Without a wave the restoring torque acts on the covariance as impulses at the ends of a step, exact to 1 %.
    share = 1e-2 if wave is None else 2e-3
    compare_filters(
        model, TorqueInput.held(30.0 * np.sign(np.sin(0.5 * time))), time, replace(NOISE, disturbance=20.0), share
    )
