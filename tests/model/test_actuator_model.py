"""The way from commands to torque."""

from __future__ import annotations

import gc
import itertools
import math
import weakref
from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import IntArray
from rovid.effects import Effect, effect_named, forms_for, in_angles
from rovid.effects.actuator_inputs import SampleSelection
from rovid.effects.base import OnTorque
from rovid.model.actuator_model import CommandSeries
from rovid.model.model import Model
from rovid.trial.trial import Past, Trial
from rovid.trial.vehicle import Steering, ThrustCurve, Thruster, Vehicle
from tests.effects.test_effects import EVERY, VEHICLE, logs, numbers
from tests.synthetic import trial


def test_the_uncertainty_of_the_thrust_scale() -> None:
    """Of a curve that bends by a power e, |e - 1| times the logarithm of the thrust over that of no change."""
    one = Thruster(
        name="one", arm=0.5, curve=ThrustCurve(command=np.array([-10.0, 10.0]), thrust=np.array([-1e3, 1e3]))
    )
    idle = replace(one, name="idle", arm=0.0)
    vehicle = Vehicle(name="", thrusters=(one, idle))
    time = np.array([0.0, 3.0, 4.0])  # 3 s of 200 N and 1 s of 600 N, and a tenth of the largest is 100 N
    commands = np.array([[2.0, 9.0], [-6.0, 9.0], [0.0, 9.0]])
    run = replace(trial(time, np.zeros(3)), commands=commands)
    bare = Model(inertia=1.0, quadratic_drag=1.0, linear_drag=1.0)
    model = replace(bare, effects=(effect_named("thrust_curve_shape"),), effect_values=(0.7,))
    squares = 0.3**2 * np.log([2.0, 6.0]) ** 2
    expected = math.sqrt(squares @ [200.0 * 3.0, 600.0 * 1.0] / 1200.0)
    assert model.actuators.thrust_scale_uncertainty(vehicle, [run]) == pytest.approx(expected)
    assert bare.actuators.thrust_scale_uncertainty(vehicle, [run]) == 0.0
    lagging = replace(bare, effects=(effect_named("thruster_lag"),), effect_values=(0.7,))
    assert lagging.actuators.thrust_scale_uncertainty(vehicle, [run]) == 0.0


LOGS = logs()
STEPS = [np.arange(first, len(log.time) - last, 7) for log, first, last in zip(LOGS, (0, 3, 1), (0, 5, 2), strict=True)]


def model_with(effect: Effect) -> Model:
    """With the parameters of its first start."""
    values = tuple(numbers(effect, start=True).tolist())
    return Model(inertia=5e3, quadratic_drag=3e3, linear_drag=1e2, effects=(effect,), effect_values=values)


@pytest.mark.parametrize("effect", EVERY, ids=lambda effect: effect.key)
def test_concatenated_trials_are_driven_like_each(effect: Effect) -> None:
    for parts, at in itertools.product((1, 4), (None, STEPS)):
        require_alike(effect, parts, at)


def require_alike(effect: Effect, parts: int, at: list[IntArray] | None) -> None:
    model, case = model_with(effect), f"{parts} parts, {'all' if at is None else 'some'} instants"
    given = CommandSeries.from_trials(VEHICLE, LOGS, parts)
    together = model.actuators.torque_inputs(given, None if at is None else given.intervals_between(at)).by_trial
    for number, found in enumerate(together):
        one = CommandSeries.from_trials(VEHICLE, [LOGS[number]], parts)
        alone = model.actuators.torque_inputs(one, None if at is None else one.intervals_between([at[number]]))
        assert len(found.torque) == len(LOGS[number].time if at is None else at[number]), case
        for name in ("torque", "timing_moment", "effect_inputs", "impulse_variance"):
            # Sums over thrusters may be rounded otherwise.
            wanted = getattr(alone, name)
            np.testing.assert_allclose(getattr(found, name), wanted, rtol=1e-12, atol=1e-9, err_msg=f"{case}: {name}")


def telling(log: Trial, steps: IntArray) -> IntArray:
    """The steps, the ends, and where the command changed or did so within half a second."""
    changed = np.append(False, np.any(np.diff(log.commands, axis=0) != 0.0, axis=1))
    since = log.time - np.maximum.accumulate(np.where(changed, log.time, -np.inf))
    keep = since <= 0.5
    keep[[0, -1]] = keep[steps] = True
    return np.flatnonzero(keep)


@pytest.mark.parametrize(
    "effect", [one for one in EVERY if model_with(one).actuators.has_exact_means], ids=lambda effect: effect.key
)
def test_instants_in_a_held_command_may_be_left_out(effect: Effect) -> None:
    model = model_with(effect)
    # Those of the logs change at every instant.
    logs = [replace(log, commands=log.commands[np.arange(len(log.time)) // 60 * 60]) for log in LOGS]
    at = [telling(log, steps) for log, steps in zip(logs, STEPS, strict=True)]
    assert sum(map(len, at)) < 0.6 * sum(len(log.time) for log in logs)
    every, few = CommandSeries.from_trials(VEHICLE, logs), CommandSeries.from_trials(VEHICLE, logs, at=at)
    places = [np.searchsorted(here, steps) for here, steps in zip(at, STEPS, strict=True)]
    over_all = model.actuators.torque_inputs(every, every.intervals_between(STEPS))
    over_few = model.actuators.torque_inputs(few, few.intervals_between(places))
    for found, wanted in zip(over_few.by_trial, over_all.by_trial, strict=True):
        # The last step has no next one: its mean ends at the next instant of the series, whichever that is. A drop
        # that follows the clock is the mean of what is held in between: 3 s, in which a day of a minute loses 0.25 %.
        rtol = 2.5e-3 if effect.form == "day" else 1e-4
        np.testing.assert_allclose(found.torque[:-1], wanted.torque[:-1], rtol=rtol, atol=1e-4)


def test_means_of_selected_samples_ignore_nan() -> None:
    time, held = np.array([0.0, 1.0, 2.0, 4.0, 5.0]), np.array([1.0, np.nan, 3.0, 5.0, 7.0])
    chosen = SampleSelection.of(time, np.array([0, 2, 4]))
    assert chosen.means(held).tolist() == [1.0, (2.0 * 3.0 + 5.0) / 3.0, 7.0]
    assert np.isnan(SampleSelection.of(time, np.array([0, 1, 2, 4])).means(held)).tolist() == [
        False,
        True,
        False,
        False,
    ]


def test_equal_command_series_are_one_object() -> None:
    first = CommandSeries.from_trials(VEHICLE, LOGS)
    assert CommandSeries.from_trials(VEHICLE, LOGS) is first
    others = [
        CommandSeries.from_trials(VEHICLE, LOGS[:2]),
        CommandSeries.from_trials(VEHICLE, LOGS, 4),
        CommandSeries.from_trials(VEHICLE, LOGS[::-1]),
    ]
    assert all(other is not first for other in others)
    gone = weakref.ref(first)
    del first
    gc.collect()
    assert gone() is None


def test_a_gear_limits_the_angle_of_a_rudder_and_not_its_torque() -> None:
    """At a speed that grows, the torque has no constant rate; the part after a cut begins at the angle before it."""
    steering = Steering(speed="surge_velocity", size=100.0, wheels=False)
    vehicle = Vehicle(name="", thrusters=(Thruster(name="rudder", arm=1.0, curve=None, steering=steering),))
    time = np.arange(0.0, 20.0, 0.5)
    speed, angle = 1.0 + 0.05 * time, np.where(time < 5.0, 0.0, 0.4)
    run = replace(
        trial(time, np.zeros(len(time))),
        commands=steering.command(angle, speed)[:, np.newaxis],
        angle_gains=steering.gain(speed)[:, np.newaxis],
        extras={"surge_velocity": speed},
    )
    turned = np.clip(0.05 * (time + 0.25 - 5.0), 0.0, 0.4)  # rad, the mean over the interval from each instant
    vehicle = vehicle.with_logged_torque([run])
    for form in ("slew_limit", "slew_limit:angle"):
        slow = replace(model_with(effect_named(form)), effect_values=(0.05,))
        torque = 100.0 * speed**2 * turned
        assert slow.torque_input(vehicle, run).torque[:-1] == pytest.approx(torque[:-1], abs=1e-9)
        late = run.part(slice(14, None), "late")
        assert slow.torque_input(vehicle, late).torque[:-1] == pytest.approx(torque[14:-1], abs=1e-9)


def test_thrust_grows_and_falls_with_a_lag_of_its_own() -> None:
    """After steps of the command the thrust is an exponential in each piece, whatever the bench curve."""
    time = np.arange(0.0, 12.0, 0.25)
    command = np.where(time < 1.0, 0.0, np.where(time < 6.0, 2.0, 1.0))
    run = replace(trial(time, command), commands=np.column_stack((command, 0.0 * command)))
    plain = VEHICLE.torque(run)
    model = replace(model_with(effect_named("thruster_lag:unequal_thrust")), effect_values=(0.5, 2.0))
    instants = time[:-1, np.newaxis] + np.arange(0.0005, 0.25, 0.001)
    top, low = plain[12], plain[32]
    grown = top * (1.0 - np.exp(-(instants - 1.0) / 0.5))
    fallen = low + (top * (1.0 - np.exp(-5.0 / 0.5)) - low) * np.exp(-(instants - 6.0) / 2.0)
    expected = np.where(instants < 1.0, 0.0, np.where(instants < 6.0, grown, fallen)).mean(axis=1)
    found = model.torque_input(VEHICLE, run).torque[:-1]
    np.testing.assert_allclose(found, expected, atol=1e-4 * top)  # means over points 1 ms apart


@pytest.mark.parametrize(("form", "power"), [("supply_sag", 1.0), ("supply_sag:power", 1.5)])
def test_a_held_command_loses_thrust_with_the_load_of_the_supply(form: str, power: float) -> None:
    time = np.arange(0.0, 60.0, 0.5)
    run = replace(trial(time, np.zeros(len(time))), commands=np.tile([2.0, 0.0], (len(time), 1)))
    model = replace(model_with(effect_named(form)), effect_values=(0.3, 2.0))
    share = VEHICLE.thrust(run.commands)[0] ** power / sum(one.full_thrust**power for one in VEHICLE.thrusters)
    expected = VEHICLE.torque(run) * (1.0 - 0.3 * share.sum())
    np.testing.assert_allclose(model.torque_input(VEHICLE, run).torque[-2], expected[-2])


def test_a_sag_without_a_lag_is_a_bent_curve_where_one_thruster_acts() -> None:
    time = np.arange(0.0, 20.0, 0.5)
    run = replace(trial(time, np.zeros(len(time))), commands=np.column_stack((2.0 * np.sin(time), 0.0 * time)))
    loss = 0.3 * VEHICLE.thrusters[0].full_thrust / sum(one.full_thrust for one in VEHICLE.thrusters)
    torques = [
        replace(model_with(effect_named(form)), effect_values=values).torque_input(VEHICLE, run).torque
        for form, values in (("supply_sag", (0.3, 0.0)), ("thrust_curve_shape:parabola", (loss,)))
    ]
    np.testing.assert_allclose(torques[0], (1.0 - 0.1 * loss) * torques[1])


def test_thrust_beyond_a_knee_grows_more_slowly() -> None:
    time = np.arange(0.0, 20.0, 0.5)
    run = replace(trial(time, np.zeros(len(time))), commands=np.column_stack((4.0 * np.sin(time), 0.0 * time)))
    thrust, full = VEHICLE.thrust(run.commands)[:, 0], VEHICLE.thrusters[0].full_thrust
    model = replace(model_with(effect_named("thrust_curve_shape:knee")), effect_values=(0.7, 0.4))
    expected = np.where(
        np.abs(thrust) > 0.4 * full, np.sign(thrust) * (0.4 + 0.3 * (np.abs(thrust) / full - 0.4)), thrust / full
    )
    assert np.ptp(expected) > 0.9
    np.testing.assert_allclose(model.torque_input(VEHICLE, run).torque, VEHICLE.thrusters[0].arm * full * expected)


@pytest.mark.parametrize("parts", [1, 4])
def test_a_sideways_acceleration_takes_its_momentum_from_the_torque(parts: int) -> None:
    time = np.arange(0.0, 10.0, 0.2)
    sway = 0.3 * np.sin(time)
    idle = replace(trial(time, np.zeros(len(time))), commands=np.zeros((len(time), 2)))
    run = replace(idle, extras={"sway_velocity": np.where(time == time[20], np.nan, sway)})
    inputs = CommandSeries.from_trials(VEHICLE, [run], parts).inputs
    act = effect_named("sideslip_moment:acceleration").acts
    assert isinstance(act, OnTorque)
    found = act.change(inputs, np.zeros(len(inputs.time)), {"mass": 50.0})[:-1].reshape(-1, parts)
    expected = np.repeat(-50.0 * np.diff(sway)[:, np.newaxis] / 0.2, parts, axis=1)
    known = np.delete(np.arange(len(expected)), [19, 20])
    np.testing.assert_allclose(found[known], expected[known])
    assert found.sum() * 0.2 / parts == pytest.approx(-50.0 * (sway[-1] - sway[0]))


def test_forms_of_commands_give_way_to_forms_of_angles_where_rudders_alone_drive() -> None:
    rudder = Thruster(name="", arm=1.0, curve=None, steering=Steering(speed="u", size=1.0, wheels=False))
    vehicle = Vehicle(name="", thrusters=(rudder,))
    keys = {form.key for form in forms_for(vehicle)}
    assert {"slew_limit:angle", "thruster_lag:angle", "command_delay"} < keys
    assert {"thruster_deadband:angle", "command_hysteresis:angle"} < keys
    assert not {"slew_limit", "thruster_deadband", "command_hysteresis", "thruster_lag:command"} & keys
    assert "slew_limit:angle" not in {form.key for form in forms_for(VEHICLE)}
    assert in_angles(effect_named("slew_limit:size")).key == "slew_limit:angle"
    assert in_angles(effect_named("thruster_lag:command")).key == "thruster_lag:command"


@pytest.mark.parametrize("past", [0, 2])
def test_series_of_trials_are_held_between_the_selected_instants_and_not_kept(past: int) -> None:
    """Mean between the instants; NaN left out. A regression tries hundreds of series of the same logs."""
    time = np.arange(5.0)
    before = Past(time=np.array([-2.0, -1.0][:past]), commands=np.zeros((past, 1)))
    runs = [replace(trial(time, np.zeros(5), name=name), past=before if past else None) for name in ("a", "b")]
    series = CommandSeries.from_trials(VEHICLE, runs, 2, [np.array([0, 2, 4])] * 2)
    held = {"a": np.array([1.0, 3.0, np.nan, 5.0, 7.0]), "b": np.full(5, 9.0)}
    found, given = series.inputs.from_trials(held), weakref.ref(held["b"])
    assert found.tolist() == [*[2.0] * past, 2.0, 2.0, 5.0, 5.0, 7.0, *[9.0] * (past + 5)]
    del held
    gc.collect()
    assert given() is None
