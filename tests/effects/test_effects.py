"""Every form of every effect: zero at its neutral value, finite everywhere, and according to its equation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.effects import CATALOGUE, FORMS, TERM_EFFECTS, Effect, bias_torque, effect_named, forms_for, supply_sag
from rovid.effects.actuator_dynamics import lagged, lagged_unequally, latched, rotor_lagged, soft_started, waited
from rovid.effects.actuator_inputs import actuator_inputs
from rovid.effects.base import (
    REFERENCE_RATE,
    SPEEDS,
    TERM_PARAMETERS,
    TERM_STATES,
    Actuating,
    ActuatorInputs,
    Body,
    Instant,
    OnCommand,
    OnHeading,
    OnThrust,
    OnTorque,
    Scales,
    Term,
)
from rovid.jit.simd import LANES
from rovid.model.bound_effects import BoundEffect, Equation, pack_terms
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tests.synthetic import trial

# What other programs rely on, in its order; further effects come after them.
IDS = [
    "thruster_deadband",
    "thrust_asymmetry",
    "thruster_imbalance",
    "thrust_curve_shape",
    "supply_sag",
    "thruster_lag",
    "command_delay",
    "slew_limit",
    "command_hysteresis",
    "advance_speed_loss",
    "bias_torque",
    "drag_curvature",
    "drag_asymmetry",
    "coulomb_resistance",
    "oscillatory_drag",
    "added_mass_memory",
    "entrained_swirl",
    "tether_torsion",
    "heading_dependent_torque",
    "wave_torque",
    "tank_seiche",
    "heading_deviation",
    "speed_dependent_damping",
    "sideslip_moment",
    "restoring_curve",
]
BODY = Body(5057.0, 3532.0, 132.0, stiffness=50.0)
SCALES = Scales(
    command=2.0,
    torque=120.0,
    rate=0.15,
    wash=math.sqrt(120.0),
    sqrt_thrust=math.sqrt(120.0),
    surge=0.8,
    sway=0.2,
    day=1.0 / 60.0,
    time=4.2,
)
TIME = np.arange(0.0, 60.0, 0.05)
CURVE = ThrustCurve(command=np.array([-5.0, -0.3, 0.3, 5.0]), thrust=np.array([-800.0, 0.0, 0.0, 1200.0]))
VEHICLE = Vehicle(
    name="test", thrusters=(Thruster(name="fore", arm=0.43, curve=CURVE), Thruster(name="aft", arm=-0.43, curve=CURVE))
)
COMMAND = np.column_stack((2.0 * np.sin(0.3 * TIME), np.where(TIME % 20.0 < 10.0, 1.5, -0.7)))
CHANNELS = {
    "supply_voltage": 14.0 - 0.02 * TIME,
    "surge_velocity": 0.8 + 0.2 * np.sin(0.1 * TIME),
    "sway_velocity": 0.2 * np.cos(0.2 * TIME),
}
WHERE = ActuatorInputs(
    time=TIME,
    neutral=np.zeros(2),
    arms=np.array([0.43, -0.43]),
    full_thrust=np.array([1200.0, 1200.0]),
    names=("fore", "aft"),
    dead_zone=np.array([[-0.3, 0.3], [-0.3, 0.3]]),
    extras=CHANNELS,
    forward_share=np.array([0.5, 0.5]),
    command_range=np.array([[-5.0, 5.0], [-5.0, 5.0]]),
)
STAND_INS = [f"{name}:estimated" for name in ("speed_dependent_damping", "sideslip_moment")]
EVERY = (*forms_for(VEHICLE, CHANNELS, ["log_0"]), *map(effect_named, STAND_INS))
ACTUATED = [effect for effect in EVERY if isinstance(effect.acts, Actuating)]

each = pytest.mark.parametrize("effect", EVERY, ids=lambda effect: effect.key)
each_term = pytest.mark.parametrize("effect", TERM_EFFECTS, ids=lambda effect: effect.key)


def numbers(effect: Effect, *, start: bool) -> FloatArray:
    """Parameters at their first start, or where the effect is not there and the others at their start, in SI."""
    firsts = [p.initial_values[0] if start or p.name in OTHERS else p.neutral for p in effect.parameters]
    return np.array([value * SCALES.unit_size(p) for value, p in zip(firsts, effect.parameters, strict=True)])


# Parameters that shape an effect, and of which it does not matter what they are when the effect is gone.
OTHERS = ("frequency", "damping", "phase", "second_phase", "swept_angle", "angle")


def torque(
    effect: Effect, values: FloatArray, command: FloatArray = COMMAND, where: ActuatorInputs = WHERE
) -> FloatArray:
    named = effect.values(values)
    command = effect.acts.change(where, command, named) if isinstance(effect.acts, OnCommand) else command
    thrust = VEHICLE.thrust(command)
    thrust = effect.acts.change(where, thrust, named) if isinstance(effect.acts, OnThrust) else thrust
    total = np.asarray(thrust @ where.arms)
    return effect.acts.change(where, total, named) if isinstance(effect.acts, OnTorque) else total


def term(effect: Effect, values: FloatArray, rate: float, push: float, state: FloatArray) -> tuple[float, FloatArray]:
    assert isinstance(effect.acts, Term)
    body, race = BODY._replace(trim=0.1), math.sqrt(abs(push))
    at = Instant(rate, rate, 3.0, 0.4, push, race, 0.8, -0.2, body)
    found, change = effect.acts.evaluate(at, tuple(values), tuple(state))
    return float(found), np.array([*change, *np.zeros(TERM_STATES - len(change))])


def simulated(effect: Effect, values: FloatArray, torque: FloatArray, time: FloatArray = TIME) -> FloatArray:
    from rovid.model.kernels import simulate_effects

    still = np.zeros(len(time))
    beside = np.column_stack([np.sqrt(np.abs(torque)), still + 0.8, still - 0.2])
    rest = np.full(1, 0.4), np.zeros((1, 2)), np.zeros((1, TERM_STATES))
    terms = pack_terms([BoundEffect(effect, values)], 0.0)
    rate, _ = simulate_effects(np.array([0, len(time)]), time, (torque, still, beside), *rest, BODY, terms)
    return np.asarray(rate)


def test_ids_of_the_catalogue_and_their_order() -> None:
    assert [effect.id for effect in CATALOGUE][: len(IDS)] == IDS
    assert not any(effect.form for effect in CATALOGUE)


def test_keys_are_unique_and_the_plain_form_stands_first() -> None:
    keys = [effect.key for effect in FORMS]
    assert len(set(keys)) == len(keys)
    ids = [effect.id for effect in CATALOGUE]
    assert list(dict.fromkeys(effect.id for effect in FORMS)) == ids
    assert [next(e for e in FORMS if e.id == name).form for name in ids] == [""] * len(ids)
    assert all(effect_named(effect.key) is effect for effect in FORMS if not effect.per_thruster)


def test_forms_of_an_effect_differ() -> None:
    parts = [(effect.id, *(getattr(effect.acts, part.name) for part in fields(effect.acts))) for effect in FORMS]
    assert len(set(parts)) == len(parts)


def test_a_form_that_needs_a_channel_is_offered_only_with_it() -> None:
    assert "supply_sag:voltage" not in [effect.key for effect in forms_for(VEHICLE)]
    assert "supply_sag:voltage" in [effect.key for effect in EVERY]


@each
def test_an_effect_is_described(effect: Effect) -> None:
    assert effect.title
    assert effect.equation
    assert effect.fingerprint
    assert effect.experiment
    assert effect.rivals
    assert set(effect.rivals) <= {one.id for one in CATALOGUE} - {effect.id}


@each
def test_initial_and_neutral_values_are_within_bounds(effect: Effect) -> None:
    names = [parameter.name for parameter in effect.parameters]
    assert len(set(names)) == len(names)
    if isinstance(effect.acts, Term):
        assert len(names) <= TERM_PARAMETERS
    for parameter in effect.parameters:
        assert parameter.low < parameter.high
        assert parameter.low <= parameter.neutral <= parameter.high
        assert parameter.initial_values
        assert all(parameter.low <= start <= parameter.high for start in parameter.initial_values)
        assert SCALES.unit_size(parameter) > 0.0


@pytest.mark.parametrize("effect", ACTUATED, ids=lambda effect: effect.key)
def test_neutral_actuator_effects_change_nothing(effect: Effect) -> None:
    plain = VEHICLE.thrust(COMMAND) @ WHERE.arms
    # A slew limit that is no limit still takes an instant.
    close = 0.01 if effect.id == "slew_limit" else 1e-9
    found = torque(effect, numbers(effect, start=False))
    # The last value would hold from the last instant on.
    np.testing.assert_allclose(found[:-1], plain[:-1], atol=close, rtol=close)


@pytest.mark.parametrize("effect", ACTUATED, ids=lambda effect: effect.key)
def test_actuator_effects_change_the_torque(effect: Effect) -> None:
    plain = VEHICLE.thrust(COMMAND) @ WHERE.arms
    changed = torque(effect, numbers(effect, start=True))
    assert np.isfinite(changed).all()
    assert np.max(np.abs(changed - plain)) > 0.1
    for parameter in effect.parameters:
        for extreme in (parameter.low, parameter.high):
            values = [
                extreme * SCALES.unit_size(p) if p is parameter else p.initial_values[0] * SCALES.unit_size(p)
                for p in effect.parameters
            ]
            assert np.isfinite(torque(effect, np.array(values))).all()


def logs() -> list[Trial]:
    """Three of different length and clock, whose first commands are not neutral; one without the channels."""
    reference = {name: float(np.median(values)) for name, values in CHANNELS.items()}
    cuts = (slice(100, 500, 1), slice(0, 1200, 3), slice(333, 1000, 2))
    made = []
    for number, cut in enumerate(cuts):
        time = TIME[cut] - TIME[cut][0]
        log = replace(trial(time, np.zeros(len(time))), commands=(1.0 + number) * COMMAND[cut], name=f"log_{number}")
        channels = {} if number == 1 else {name: values[cut] for name, values in CHANNELS.items()}
        made.append(replace(log, extras=channels, reference=reference, campaign_time=600.0 * number))
    return made


@pytest.mark.parametrize("parts", [1, 4])
@pytest.mark.parametrize(
    "effect",
    [
        *ACTUATED,
        supply_sag.for_trials(["log_2"]),
        supply_sag.for_trials(["log_1", "log_2"]),
        bias_torque.for_trials(["log_0", "log_2"]),
    ],
    ids=lambda effect: effect.key,
)
def test_effects_treat_concatenated_trials_separately(effect: Effect, parts: int) -> None:
    each_log = [actuator_inputs(VEHICLE, log, parts) for log in logs()]
    commands = [where.subdivide(log.commands) for where, log in zip(each_log, logs(), strict=True)]
    values = numbers(effect, start=True)
    together = torque(effect, values, np.concatenate(commands), ActuatorInputs.concatenated(each_log))
    alone = [torque(effect, values, command, where) for command, where in zip(commands, each_log, strict=True)]
    # Sums over thrusters may be rounded otherwise.
    np.testing.assert_allclose(together, np.concatenate(alone), rtol=1e-12, atol=1e-12)


def test_a_speed_that_is_not_logged_is_the_campaigns_median() -> None:
    each_log = [actuator_inputs(VEHICLE, log, 2) for log in logs()]
    joined = ActuatorInputs.concatenated(each_log)
    for name in SPEEDS:
        np.testing.assert_array_equal(joined.speed(name), np.concatenate([one.speed(name) for one in each_log]))
    (rows,) = [one.rows for one in joined.trials if one.name == "log_1"]
    assert (joined.speed(SPEEDS[0])[rows] == joined.reference[SPEEDS[0]]).all()
    assert joined.campaign_time[joined.offsets[:-1]].tolist() == [0.0, 600.0, 1200.0]


@each_term
def test_neutral_terms_are_zero(effect: Effect) -> None:
    values = numbers(effect, start=False)
    for rate in (-0.4, 0.0, 0.1):
        found, _ = term(effect, values, rate, 150.0, np.array([0.1, -0.2]))
        assert found == pytest.approx(0.0, abs=1e-9)


@each_term
def test_a_term_is_finite_in_any_state(effect: Effect) -> None:
    for extreme in ("start", "low", "high"):
        values = [p.initial_values[0] if extreme == "start" else getattr(p, extreme) for p in effect.parameters]
        values = [value * SCALES.unit_size(p) for value, p in zip(values, effect.parameters, strict=True)]
        for rate in (-5.0, -1e-9, 0.0, 1e-9, 0.2, 5.0):
            for push in (-2000.0, -1e-12, 0.0, 1e-12, 2000.0):
                for state in (np.zeros(2), np.array([1.0, -1.0]), np.array([-30.0, 50.0])):
                    found, change = term(effect, np.array(values), rate, push, state)
                    assert np.isfinite([found, *change]).all()


@each_term
def test_a_term_depends_on_its_declared_states_only(effect: Effect) -> None:
    """Those that have none are not told any."""
    assert isinstance(effect.acts, Term)
    values = numbers(effect, start=True)
    here, change = term(effect, values, 0.2, 150.0, np.array([0.1, -0.2]))
    there, _ = term(effect, values, 0.2, 150.0, np.array([0.3, 0.4]))
    assert bool(effect.acts.states) == bool(change.any() or here != there)
    assert effect.acts.states <= TERM_STATES


@each_term
def test_a_term_is_finite_without_drag(effect: Effect) -> None:
    assert isinstance(effect.acts, Term)
    for quadratic, linear in ((0.0, 100.0), (3000.0, 0.0), (0.0, 0.0)):
        at = Instant(0.1, 0.1, 3.0, 0.0, 100.0, 0.0, 0.0, 0.0, Body(5057.0, quadratic, linear))
        found, change = effect.acts.evaluate(at, tuple(numbers(effect, start=True)), (0.0,) * TERM_STATES)
        assert np.isfinite([found, *change]).all()


@each_term
def test_a_term_simulates(effect: Effect) -> None:
    changes = []
    # A term may act on a turn to one side only.
    for push in VEHICLE.thrust(COMMAND) @ WHERE.arms * np.array([[1.0], [-1.0]]):
        nothing = simulated(effect, numbers(effect, start=False), push)
        plain = simulated(effect_named("bias_torque"), np.zeros(1), push)
        np.testing.assert_allclose(nothing, plain, atol=1e-5)
        changes.append(simulated(effect, numbers(effect, start=True), push) - plain)
    assert np.isfinite(changes).all()
    assert np.max(np.abs(changes)) > 1e-5


@pytest.mark.parametrize("effect", [e for e in FORMS if isinstance(e.acts, OnHeading)], ids=lambda effect: effect.key)
def test_a_neutral_deviation_is_zero_and_any_deviation_is_monotonic(effect: Effect) -> None:
    assert isinstance(effect.acts, OnHeading)
    heading = np.linspace(-10.0, 10.0, 2001)
    nothing = effect.acts.deviation(heading, effect.values(numbers(effect, start=False)))
    np.testing.assert_array_equal(nothing, 0.0)
    largest = effect.values(np.array([parameter.high for parameter in effect.parameters]))
    there = effect.acts.deviation(heading, largest)
    assert np.all(np.diff(heading + there) > 0.0)
    # A turn farther it is the same.
    np.testing.assert_allclose(effect.acts.deviation(heading + 2.0 * np.pi, largest), there, atol=1e-12)


@pytest.mark.parametrize("effect", [e for e in FORMS if e.canonical], ids=lambda effect: effect.key)
def test_canonical_parameters_are_equivalent(effect: Effect) -> None:
    assert effect.canonical is not None
    low, high = np.transpose([(parameter.low, parameter.high) for parameter in effect.parameters])
    odd = np.clip(np.array([-0.1, 5.0, 0.05, -4.0, -0.02, 3.5])[: len(effect.parameters)], low, high)
    tidy = effect.canonical(odd)
    assert np.all(tidy[::2] >= 0.0)
    assert np.all(np.abs(tidy[1::2]) <= math.pi)
    if isinstance(effect.acts, OnHeading):
        heading = np.linspace(0.0, 7.0, 50)
        deviation = effect.acts.deviation(heading, effect.values(odd))
        np.testing.assert_allclose(effect.acts.deviation(heading, effect.values(tidy)), deviation, atol=1e-12)
    else:
        before, after = (term(effect, values, 0.1, 0.0, np.zeros(2))[0] for values in (odd, tidy))
        assert after == pytest.approx(before)


def test_the_rotor_is_exact_between_instants() -> None:
    time = np.array([0.0, 0.7, 1.5, 3.0, 3.4, 6.0, 6.5])
    thrust = np.array([0.0, 2.0, -1.5, 0.3, 0.0, -0.8, 0.0])
    coarse = rotor_lagged(time, thrust, 0.4)
    fine = np.arange(0.0, 6.5, 1e-4)
    held = thrust[np.searchsorted(time, fine + 1e-9, side="right") - 1]
    speed, passed = 0.0, np.zeros(len(fine))
    for k, goal in enumerate(held):
        passed[k] = speed * abs(speed)
        speed += 1e-4 * (goal - speed * abs(speed)) / 0.8
    means = [passed[(fine >= a - 1e-9) & (fine < b - 1e-9)].mean() for a, b in pairwise(time)]
    np.testing.assert_allclose(coarse[:-1], means, atol=2e-3)


def test_the_rotor_has_its_time_constant_at_the_reference_thrust() -> None:
    effect = effect_named("thruster_lag:rotor")
    assert isinstance(effect.acts, OnThrust)
    thrust = np.full((len(TIME), 2), 120.0) + 1.0 * (TIME > 0.0)[:, None]
    late = effect.acts.change(WHERE, thrust, {"time_constant": 2.0})[:, 0] - 120.0
    # The first instant lasts 0.05 s; each value is the mean of the next 0.05 s.
    assert late[np.searchsorted(TIME, 2.05)] == pytest.approx(1.0 - math.exp(-2.025 / 2.0), abs=0.01)


def test_a_soft_start_limits_growth_only() -> None:
    time = np.arange(0.0, 6.0, 0.5)
    values = np.array([0.0, 2.0, 2.0, 2.0, 2.0, 0.5, 0.5, -1.0, -1.0, -1.0, 0.0, 0.0])
    expected = [0.0, 0.25, 0.75, 1.25, 1.75, 0.5, 0.5, -0.25, -0.75, -1.0, 0.0, 0.0]
    np.testing.assert_allclose(soft_started(time, values, 1.0), expected)


def test_a_limit_on_the_size_lets_a_reversal_pass() -> None:
    effect = effect_named("slew_limit:size")
    assert isinstance(effect.acts, OnCommand)
    where = replace(WHERE, time=np.arange(6.0), neutral=np.array([0.5]))
    command = 0.5 + np.array([[0.0], [2.0], [2.0], [-1.0], [-1.0], [-3.0]])
    late = effect.acts.change(where, command, {"rate": 1.0})[:, 0] - 0.5
    np.testing.assert_allclose(late, [0.0, 0.5, 1.5, -1.0, -1.0, -1.0])


def test_an_unequal_lag_depends_on_whether_the_size_grows() -> None:
    time = np.array([0.0, 0.3, 1.0, 1.1, 2.0, 2.6, 3.5, 4.0])
    values = np.array([0.5, 2.0, -1.0, -1.0, 0.0, -2.0, 1.5, 1.5])
    np.testing.assert_allclose(lagged_unequally(time, values, 0.4, 0.4), lagged(time, values, 0.4))
    found, step, state = lagged_unequally(time, values, 0.2, 0.7), 1e-4, values[0]
    for k, (begin, end) in enumerate(pairwise(time)):
        passed = 0.0
        for _ in range(round((end - begin) / step)):
            state += (values[k] - state) * step / (0.2 if abs(values[k]) > abs(state) else 0.7)
            passed += state * step
        assert found[k] == pytest.approx(passed / (end - begin), abs=1e-3)  # of the steps


def test_thrust_waits_after_a_reversal_and_no_other_change() -> None:
    thrust = np.array([0.0, 1.0, 2.0, -2.0, -1.0, 0.0, -2.0, 0.0, 3.0, 3.0, 3.0])
    expected = [0.0, 1.0, 2.0, 0.0, -0.75, 0.0, -2.0, 0.0, 0.0, 2.25, 3.0]
    np.testing.assert_allclose(waited(np.arange(11.0), thrust, 1.25), expected)


def test_a_slack_tether_pulls_beyond_its_slack() -> None:
    effect = effect_named("tether_torsion:slack")
    assert isinstance(effect.acts, Term)
    at = [Instant(0.0, 0.0, angle, 0.0, 0.0, 0.0, 0.0, 0.0, BODY) for angle in (-2.0, 1.0, 4.5)]
    assert [effect.acts.evaluate(one, (2.0, 1.5), ())[0] for one in at] == [1.0, 0.0, -6.0]


def test_a_latch_closes_above_its_width_and_opens_at_zero() -> None:
    excess = np.array([0.0, 0.5, 1.5, 0.5, 0.0, 0.5, -0.5, -1.5, -0.5, 0.5])
    np.testing.assert_allclose(
        latched(np.arange(10.0), excess, 1.0, 0.1), [0.0, 0.0, 1.5, 0.5, 0.0, 0.0, 0.0, -1.5, -0.5, 0.0]
    )


def test_random_delays_have_the_computed_impulse_variance() -> None:
    effect = effect_named("command_delay:scattered")
    assert isinstance(effect.acts, OnTorque)
    assert effect.acts.impulse_variance is not None
    where = replace(WHERE, time=np.arange(0.0, 5.0, 0.01))
    step, values = np.where(where.time < 2.0, -20.0, 40.0), {"delay": 0.5, "jitter": 0.6}
    lost = 60.0 * np.random.default_rng().uniform(0.2, 0.8, 100_000)
    late = step - effect.acts.change(where, step, values)
    assert float(np.sum(late)) * 0.01 == pytest.approx(float(lost.mean()), rel=0.02)
    scatter = effect.acts.impulse_variance(where, step, values)
    assert float(np.sum(scatter)) == pytest.approx(float(lost.var()), rel=0.05)
    open_still = (where.time > 2.2 - 0.02) & (where.time < 2.8 + 0.02)
    assert not scatter[~open_still].any()


def test_a_jump_has_no_thrust_inside_the_dead_band() -> None:
    effect = effect_named("thruster_deadband:jump")
    assert isinstance(effect.acts, OnCommand)
    command = np.array([[-1.0, 0.2], [-0.5, 0.45], [0.1, 0.55], [0.0, 3.0]])
    found = effect.acts.change(WHERE, command, {"deadband": 0.2, "edge": 0.1})
    np.testing.assert_allclose(found, [[-1.0, 0.0], [-0.4, 0.0], [0.0, 0.55], [0.0, 3.0]])


def test_shapes_of_the_thrust_curve_agree_at_a_tenth_of_full_thrust() -> None:
    for key, values in (
        ("thrust_curve_shape", {"exponent": 1.3}),
        ("thrust_curve_shape:saturating", {"loss": 2.0}),
        ("thrust_curve_shape:saturating", {"loss": -0.4}),
    ):
        effect = effect_named(key)
        assert isinstance(effect.acts, OnThrust)
        there = effect.acts.change(WHERE, np.array([[120.0, -120.0], [500.0, 10.0]]), values)
        np.testing.assert_allclose(there[0], [120.0, -120.0])
        assert (there[1, 0] < 500.0) == (values.get("loss", -1.0) > 0.0)


def test_growing_asymmetry_has_its_gain_at_the_reference() -> None:
    effect = effect_named("thrust_asymmetry:growing")
    assert isinstance(effect.acts, OnThrust)
    found = effect.acts.change(WHERE, np.array([[-120.0, 120.0], [-12.0, -2000.0]]), {"reverse_gain": 0.8})
    np.testing.assert_allclose(found, [[-96.0, 120.0], [-12.0 * 0.98, 0.0]], atol=1e-12)


def test_the_voltage_is_relative_to_the_campaigns_median() -> None:
    effect = effect_named("supply_sag:voltage")
    assert isinstance(effect.acts, OnThrust)
    thrust = np.full((len(TIME), 2), 100.0)
    voltage = np.full(len(TIME), 12.0)
    voltage[5] = np.nan
    where = replace(WHERE, extras={"supply_voltage": voltage}, reference={"supply_voltage": 16.0})
    found = effect.acts.change(where, thrust, {"exponent": 2.0})[:, 0]
    np.testing.assert_allclose(np.delete(found, 5), 56.25)
    assert found[5] == 100.0
    # A trial without the channel is as the bench says.
    np.testing.assert_array_equal(effect.acts.change(replace(WHERE, extras={}), thrust, {"exponent": 2.0}), thrust)


def test_open_water_form_from_small_to_large_advance() -> None:
    plain, bent = effect_named("advance_speed_loss"), effect_named("advance_speed_loss:open_water")
    few = [term(effect, np.array([2.0]), 0.01, 150.0, np.zeros(2))[0] for effect in (plain, bent)]
    assert few[1] == pytest.approx(few[0], rel=0.01)
    assert term(bent, np.array([2.0]), 50.0, 150.0, np.zeros(2))[0] == pytest.approx(-150.0)
    assert term(bent, np.array([2.0]), -50.0, 150.0, np.zeros(2))[0] == pytest.approx(75.0)
    # Where the curve crosses zero it does so without a step.
    losses = [-term(bent, np.array([1.0]), r, 1.0, np.zeros(2))[0] for r in np.linspace(-1.0, 1.0, 2001)]
    assert np.all(np.diff(losses) >= 0.0)
    assert np.max(np.diff(losses)) < 0.004


def test_the_annulus_reaches_its_share_with_its_time_constant() -> None:
    effect = effect_named("entrained_swirl:annulus")
    values = np.array([0.2, 30.0])
    steady = 0.2 * REFERENCE_RATE
    _, still = term(effect, values, REFERENCE_RATE, 0.0, np.array([steady, 0.0]))
    assert still[0] == pytest.approx(0.0, abs=1e-12)
    _, back = term(effect, values, REFERENCE_RATE, 0.0, np.array([steady + 1e-6, 0.0]))
    assert back[0] == pytest.approx(-1e-6 / 30.0, rel=1e-3)


@pytest.mark.parametrize("swirl", ["entrained_swirl", "entrained_swirl:annulus"])
@pytest.mark.parametrize(
    ("key", "values", "torque"),
    [
        ("drag_curvature", (20_000.0,), lambda slip: 20_000.0 * slip**3),
        ("drag_curvature:exponent", (1.6,), lambda slip: 3532.0 * 0.09 * (slip / 0.3) ** 1.6 - 3532.0 * slip**2),
        ("drag_asymmetry", (1.4,), lambda slip: 0.4 * (3532.0 * slip + 132.0) * slip),
        ("drag_asymmetry:quadratic", (1.4,), lambda slip: 0.4 * 3532.0 * slip**2),
        ("oscillatory_drag", (2.0, 1e6), lambda slip: 2.0 * 3532.0 * slip**2),
    ],
)
def test_all_drag_depends_on_the_relative_rate(
    swirl: str, key: str, values: tuple[float, ...], torque: Callable[[float], float]
) -> None:
    """A long turn under -100 N m ends where the drag of the slip is as much, in whichever order the causes stand."""
    time = np.arange(0.0, 1500.0, 0.5)
    rates = []
    for order in (1, -1):
        pairs = [(effect_named(swirl), (0.25, 40.0)), (effect_named(key), values)][::order]
        model = Model(
            inertia=5057.0,
            quadratic_drag=3532.0,
            linear_drag=132.0,
            effects=tuple(effect for effect, _ in pairs),
            effect_values=tuple(value for _, own in pairs for value in own),
        )
        rate, _ = model.simulate(trial(time, np.zeros(len(time))), TorqueInput.held(np.full(len(time), -100.0)))
        rates.append(rate[-1])
    assert rates[0] == rates[1]
    if swirl == "entrained_swirl":
        slip = 0.75 * abs(rates[0])
        assert 3532.0 * slip**2 + 132.0 * slip + torque(slip) == pytest.approx(100.0, rel=1e-3)


def test_algebraic_drag_falls_with_the_angle_swept() -> None:
    effect = effect_named("oscillatory_drag:algebraic")
    quadratic = BODY.quadratic_drag * 0.1**2
    for swept in (0.0, 1.0, 5.0):
        found, _ = term(effect, np.array([0.5, 2.0]), 0.1, 0.0, np.array([swept, 0.0]))
        assert found == pytest.approx(-0.5 / (1.0 + swept / 2.0) * quadratic)


def test_the_exponent_of_the_drag_agrees_with_the_square_at_the_reference() -> None:
    effect = effect_named("drag_curvature:exponent")
    assert term(effect, np.array([1.7]), REFERENCE_RATE, 0.0, np.zeros(2))[0] == pytest.approx(0.0, abs=1e-9)
    whole = term(effect, np.array([1.7]), -0.1, 0.0, np.zeros(2))[0] + BODY.quadratic_drag * 0.01
    assert whole == pytest.approx(BODY.quadratic_drag * 0.09 * (1.0 / 3.0) ** 1.7)


def test_friction_stops_a_coasting_vehicle() -> None:
    push = np.where(TIME < 20.0, 40.0, 0.0)
    plain = simulated(effect_named("bias_torque"), np.zeros(1), push)
    for key in ("coulomb_resistance", "coulomb_resistance:stiction"):
        rate = simulated(effect_named(key), np.array([15.0, 0.005]), push)
        assert plain[-1] > 0.01
        assert abs(rate[-1]) < 1e-3


def test_static_friction_is_larger_by_its_excess() -> None:
    numbers = np.array([15.0, 0.001, 0.6, 0.02])
    found = [term(effect_named("coulomb_resistance:stribeck"), numbers, r, 0.0, np.zeros(2))[0] for r in (0.004, 0.2)]
    assert found == pytest.approx([-15.0 * (1.0 + 0.6 * math.exp(-0.04)), -15.0], rel=1e-3)


def test_friction_may_change_its_sign_over_most_of_the_rates_in_use() -> None:
    """A vehicle that friction holds at rest for most of the time has a small RMS rate."""
    width = effect_named("coulomb_resistance").parameters[1]
    assert width.high * SCALES.unit_size(width) > 0.7 * SCALES.rate


def test_the_range_of_a_swept_angle_suits_a_vehicle_that_hardly_turns() -> None:
    angle = effect_named("oscillatory_drag").parameters[1]
    slow = Scales(command=1.0, torque=1.0, rate=0.005, wash=1.0, time=20.0)
    assert angle.low * slow.unit_size(angle) < 0.01
    assert angle.high * slow.unit_size(angle) > 0.2


def test_friction_that_stretches_grows_with_the_angle_turned() -> None:
    effect, numbers = effect_named("coulomb_resistance:presliding"), np.array([15.0, 0.2])
    share, turned = 0.0, 0.0
    for _ in range(2000):
        torque, change = term(effect, numbers, 0.1, 0.0, np.array([share, 0.0]))[:2]
        assert torque == pytest.approx(-15.0 * (1.0 - math.exp(-turned / 0.2)), abs=0.01)
        share, turned = share + 0.005 * change[0], turned + 0.005 * 0.1


def test_a_tank_oscillates_at_its_frequency_and_decays() -> None:
    push = np.where(TIME < 1.0, 100.0, 0.0)
    plain = simulated(effect_named("bias_torque"), np.zeros(1), push)
    for key in ("tank_seiche", "tank_seiche:thrust"):
        ring = simulated(effect_named(key), np.array([0.05, 2.0, 0.03]), push) - plain
        late = ring[TIME > 5.0] - np.convolve(ring, np.ones(63) / 63.0, mode="same")[TIME > 5.0]
        power = np.abs(np.fft.rfft(late[:-63] * np.hanning(len(late) - 63)))
        peak = 2.0 * math.pi * np.argmax(power[1:]) / ((len(late) - 63) * 0.05) + 2.0 * math.pi / (len(late) * 0.05)
        assert peak == pytest.approx(2.0, abs=0.2)
        assert np.ptp(late[-200:-63]) < 0.3 * np.ptp(late[:137])


def test_porous_memory_is_slower_at_a_small_relative_rate() -> None:
    effect = effect_named("added_mass_memory:porous")
    _, fast = term(effect, np.array([100.0, 20.0]), REFERENCE_RATE, 0.0, np.zeros(2))
    _, slow = term(effect, np.array([100.0, 20.0]), 0.1 * REFERENCE_RATE, 0.0, np.zeros(2))
    assert fast[0] == pytest.approx(REFERENCE_RATE / 20.0, rel=0.02)
    assert slow[0] == pytest.approx(fast[0] / 100.0, rel=0.02)


def test_memory_shorter_than_the_integration_resolves_is_finite() -> None:
    """An unbounded rate of the state would make the whole simulation NaN."""
    memory, push = effect_named("added_mass_memory"), np.where(TIME < 30.0, 120.0, -120.0)
    shortest, resolved = (simulated(memory, np.array([500.0, time_constant]), push) for time_constant in (1e-12, 1e-3))
    assert np.all(np.isfinite(resolved))
    assert shortest == pytest.approx(resolved, rel=1e-12)


def test_step_responses_of_the_double_and_spin_lags() -> None:
    """At 2 s of 1 s: 1 − exp(−2) of the command or the speed, and 1 − 3·exp(−2) after two lags (Laplace)."""
    time = np.arange(0.0, 4.0, 0.01)
    where = replace(WHERE, time=time)
    step = np.where(time[:, np.newaxis] < 1.0, 0.0, np.array([2.0, -3.0]))
    double, spin = effect_named("thruster_lag:double"), effect_named("thruster_lag:spin")
    assert isinstance(double.acts, OnCommand)
    assert isinstance(spin.acts, OnThrust)
    at = round(3.0 / 0.01)
    left = math.exp(-2.0)
    late = double.acts.change(where, step, {"time_constant": 1.0})[at]
    assert late == pytest.approx((1.0 - 3.0 * left) * np.array([2.0, -3.0]), rel=0.01)
    spun = spin.acts.change(where, step, {"time_constant": 1.0})[at]
    assert spun == pytest.approx((1.0 - left) ** 2 * np.array([2.0, -3.0]), rel=0.01)


def test_the_following_form_of_a_tank() -> None:
    """Water that has come to follow a rate pulls no more; else its own acceleration is what pulls."""
    effect, frequency, damping = effect_named("tank_seiche:following"), 0.8, 0.1
    values = np.array([0.2, frequency, damping])
    # In steady motion: x0 = r/ω², x1 = 0.
    torque, change = term(effect, values, 0.3, 0.0, np.array([0.3 / frequency**2, 0.0]))
    assert torque == 0.0
    assert change == pytest.approx([0.0, 0.0], abs=1e-12)
    torque, _ = term(effect, values, 0.3, 0.0, np.array([0.0, 0.5]))
    assert torque == pytest.approx(-0.2 * BODY.inertia * frequency**2 * 0.5)


def test_the_low_frequency_inertia() -> None:
    memory = effect_named("added_mass_memory")
    model = Model(inertia=5.0, quadratic_drag=1.0, linear_drag=1.0, effects=(memory,), effect_values=(-3.5, 2.0))
    assert model.low_frequency_inertia == pytest.approx(1.5)
    assert replace(model, effects=(), effect_values=()).low_frequency_inertia == 5.0


@pytest.mark.parametrize("key", ["tank_seiche:thrust", "advance_speed_loss:open_water"])
def test_other_torque_does_not_excite_thrust_dependent_terms(key: str) -> None:
    from rovid.model.kernels import SCRATCH_ROWS, advance

    effect = effect_named(key)
    values = numbers(effect, start=True)
    body = BODY._replace(stiffness=0.0)
    beside = np.array([math.sqrt(150.0), 0.0, 0.0])

    def rates(push: float, other: float, acting: list[BoundEffect]) -> list[float]:
        equation = Equation(body, pack_terms(acting, 1.0), 0.4)
        r, a, stiffness, found = 0.0, 0.0, 0.0, []
        rows = len(acting) * TERM_STATES
        state, work = np.zeros((rows, LANES)), np.zeros((3, rows + SCRATCH_ROWS, LANES))
        for _ in range(200):
            r, a, stiffness = advance(r, a, push, other, 0.0, beside, 0.1, equation, state, work, stiffness)
            found.append(r)
        return found

    plain, with_effect = rates(0.0, 150.0, []), [BoundEffect(effect, values)]
    assert rates(0.0, 150.0, with_effect) == pytest.approx(plain, abs=1e-6)
    assert rates(150.0, 0.0, with_effect) != pytest.approx(plain, abs=1e-3)
