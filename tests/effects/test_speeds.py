"""Effects that depend on the speed, with data of a boat that another model simulates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from rovid.core.array_types import FloatArray
from rovid.effects import effect_named, forms_for
from rovid.effects.base import SPEEDS, OnCommand, OnThrust
from rovid.model.model import Model
from rovid.model.torque_input import Intervals, TorqueInput
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tests.conftest import Rovid
from tests.effects.test_effects import WHERE
from tests.synthetic import trial

# A boat of 60 kg with two thrusters aft.
MASS, SURGE_DRAG, INERTIA, QUADRATIC, LINEAR, DAMPING, ARM = 60.0, 12.0, 15.0, 3.0, 3.0, 6.0, 0.4
LEVELS = np.array([[0.9, 0.9], [0.9, 0.2], [0.2, 0.9], [0.0, 0.6], [-0.5, 0.5], [0.5, -0.5], [1.0, 0.6], [0.0, 0.0]])
THRUST = 40.0
TOML = """
[vehicle]
mass = 60.0
[[thrusters]]
name = "port"
yaw_arm = 0.4
surge = 1.0
curve = "curve.csv"
command = { csv = "port" }
[[thrusters]]
name = "starboard"
yaw_arm = -0.4
surge = 1.0
curve = "curve.csv"
command = { csv = "starboard" }
[signals]
time = { csv = "time_s" }
heading = { csv = "heading_deg" }
"""


def sailed(seed: int, drift: float = 0.0, munk: float = 0.0, cross_flow: float = 40.0) -> pd.DataFrame:
    """120 s in steps of 4 s, at 10 Hz; a hull that sways turns by ``drift`` in N s and, as it goes, ``munk`` in kg."""
    rng = np.random.default_rng(seed)
    orders = LEVELS[rng.permutation(np.arange(30) % len(LEVELS))]
    rows, state = [], np.zeros(4)
    for number, order in enumerate(orders):
        thrust = THRUST * order * np.abs(order)

        def slope(_: float, y: FloatArray, thrust: FloatArray = thrust) -> list[float]:
            u, v, r, _psi = y
            drag = (QUADRATIC * abs(r) + LINEAR + (0.0 if drift or munk else DAMPING) * abs(u)) * r
            drag += (drift + munk * u) * v
            return [
                (thrust.sum() - SURGE_DRAG * abs(u) * u) / MASS,
                -(MASS * u * r + (60.0 + cross_flow * abs(v)) * v) / (1.5 * MASS),
                (ARM * (thrust[0] - thrust[1]) - drag) / INERTIA,
                r,
            ]

        time = np.arange(0, 41) * 0.1
        solved = solve_ivp(slope, (0.0, 4.0), state, t_eval=time, rtol=1e-8, atol=1e-10).y
        state = solved[:, -1]
        u, _, _, psi = solved[:, :-1]
        rows.append(np.column_stack([time[:-1] + 4.0 * number, np.degrees(psi), u, *(np.full(40, o) for o in order)]))
    log = np.vstack(rows)
    log[:, 1] = np.round(np.mod(log[:, 1] + rng.normal(0.0, 0.05, len(log)), 360.0), 3)
    log[:, 2] = np.round((log[:, 2] + rng.normal(0.0, 0.01, len(log))) * 3600.0 / 1852.0, 4)
    return pd.DataFrame(log, columns=["time_s", "heading_deg", "speed_kn", "port", "starboard"])


def launched(seed: int) -> pd.DataFrame:
    """240 s at 10 Hz of a launch with a bow and a stern thruster, that goes ahead and astern as it likes."""
    rng = np.random.default_rng(seed)
    time = 0.1 * np.arange(2401)
    speed = 1.5 * np.sin(2.0 * np.pi * time / 97.0 + rng.uniform(-3.0, 3.0))
    orders = np.repeat(LEVELS[rng.permutation(np.arange(48) % len(LEVELS))], 50, axis=0)
    bollard = THRUST * orders * np.abs(orders)
    lost = 0.5 * np.abs(speed[:-1, np.newaxis]) / np.sqrt(np.abs(bollard) + 1e-9)
    torque = ARM * np.subtract(*(bollard / (1.0 + lost)).T)

    def slope(t: float, y: FloatArray) -> list[float]:
        r = y[0]
        return [(torque[min(int(t / 0.1 + 1e-9), 2399)] - (QUADRATIC * abs(r) + LINEAR) * r) / INERTIA, r]

    _, psi = solve_ivp(slope, (0.0, 240.0), [0.0, 1.0], t_eval=time, max_step=0.1, rtol=1e-6).y
    heading = np.round(np.mod(np.degrees(psi) + rng.normal(0.0, 0.05, len(time)), 360.0), 3)
    knots = np.round((speed + rng.normal(0.0, 0.01, len(time))) * 3600.0 / 1852.0, 4)
    log = np.column_stack([time, heading, knots, np.vstack([orders, orders[-1]])])
    return pd.DataFrame(log, columns=["time_s", "heading_deg", "speed_kn", "port", "starboard"])


def boat(folder: Path, more: str = "", drift: float = 0.0, munk: float = 0.0, cross_flow: float = 40.0) -> None:
    folder.mkdir()
    (folder / "rovid.toml").write_text(TOML + more)
    command = np.linspace(-1.0, 1.0, 41)
    curve = {"command": command, "thrust_N": THRUST * command * np.abs(command)}
    pd.DataFrame(curve).to_csv(folder / "curve.csv", index=False)
    for seed in range(3):
        sailed(seed, drift, munk, cross_flow).to_csv(folder / f"run_{seed}.csv", index=False)


def test_damping_with_a_logged_speed_is_measured(tmp_path: Path, rovid: Rovid) -> None:
    boat(tmp_path / "day", 'surge_velocity = { csv = "speed_kn", unit = "kn" }\n')
    fit = rovid("fit", "day", "--effect", "speed_dependent_damping", "--json").document
    truth = {"inertia": INERTIA, "linear_drag": LINEAR, "speed_dependent_damping.linear": DAMPING}
    for name, value in truth.items():
        found = fit["parameters"][name]
        assert abs(found["value"] - value) < max(4.0 * found["standard_error"], 0.01 * value), name
    assert fit["free_run_r2"]["this_fit"] > 0.999 > fit["free_run_r2"]["simulation_fit"] + 0.01


@pytest.mark.slow
def test_the_speed_is_estimated_from_the_thrust_ahead(tmp_path: Path, rovid: Rovid) -> None:
    boat(tmp_path / "day")
    plain = rovid("fit", "day", "--json", "-p", "plain.toml").document
    fit = rovid("fit", "day", "--effect", "speed_dependent_damping:estimated", "--json").document
    assert fit["parameters"]["inertia"]["value"] == pytest.approx(INERTIA, rel=0.05)
    missed, left = (1.0 - document["free_run_r2"]["this_fit"] for document in (plain, fit))
    assert left < 0.2 * missed
    # A boat of this mass at half its speed: m/(2 X u).
    lag = fit["parameters"]["speed_dependent_damping:estimated.time_constant"]["value"]
    assert 0.3 < lag / (MASS / (2.0 * SURGE_DRAG * 1.2)) < 3.0


@pytest.mark.slow
def test_sideslip_without_logged_speeds_is_named(tmp_path: Path, rovid: Rovid) -> None:
    boat(tmp_path / "day", drift=5.0)
    said = rovid("diagnose", "day", "--json").document
    assert said["findings"][0]["effect"] == "sideslip_moment"
    assert said["findings"][0]["held_out_log_likelihood_gain"] > 0.0
    rate_r2 = [said[side]["held_out"]["yaw_rate_r2"] for side in ("base", "extended")]
    assert 1.0 - rate_r2[1] < 0.5 * (1.0 - rate_r2[0])


@pytest.mark.slow
@pytest.mark.parametrize("cross_flow", [0.0, 40.0])
def test_a_munk_moment_without_logged_sway_is_named(cross_flow: float, tmp_path: Path, rovid: Rovid) -> None:
    boat(tmp_path / "day", 'surge_velocity = { csv = "speed_kn", unit = "kn" }\n', munk=4.0, cross_flow=cross_flow)
    said = rovid("diagnose", "day", "--json").document
    assert said["findings"][0]["effect"] == "sideslip_moment"
    assert said["findings"][0]["form"] == "carried"
    assert said["findings"][0]["held_out_log_likelihood_gain"] > 0.0
    before, after = (said[side]["parameters"]["inertia"] for side in ("base", "extended"))
    assert abs(after["value"] - INERTIA) < 3.0 * after["standard_error"]
    assert abs(after["value"] - INERTIA) < 0.2 * abs(before["value"] - INERTIA)


@pytest.mark.slow
def test_loss_of_a_tunnel_thruster_at_speed_is_named(tmp_path: Path, rovid: Rovid) -> None:
    """A launch whose main propeller is in no log; jets across the way lose as 1/(1 + ratio), not as the equation."""
    day = tmp_path / "day"
    boat(day, 'surge_velocity = { csv = "speed_kn", unit = "kn" }\n')
    (day / "rovid.toml").write_text((day / "rovid.toml").read_text().replace("surge = 1.0\n", ""))
    for seed in range(3):
        launched(seed).to_csv(day / f"run_{seed}.csv", index=False)
    said = rovid("diagnose", "day", "--json").document
    assert said["findings"][0]["effect"] == "advance_speed_loss"
    assert said["findings"][0]["form"] == "across"
    assert said["findings"][0]["held_out_log_likelihood_gain"] > 0.0


def test_a_missing_speed_channel_is_named(tmp_path: Path, rovid: Rovid) -> None:
    boat(tmp_path / "day")
    done = rovid("fit", "day", "--effect", "sideslip_moment:both")
    assert done.code == 2
    assert "needs surge_velocity and sway_velocity, which not all of these logs hold" in done.err


def test_estimated_forms_are_offered_when_needed() -> None:
    curve = ThrustCurve(command=np.array([-1.0, 1.0]), thrust=np.array([-9.0, 9.0]))
    told = Vehicle(name="boat", thrusters=(Thruster(name="aft", arm=0.4, curve=curve, surge_share=1.0),))
    untold = replace(told, thrusters=(replace(told.thrusters[0], surge_share=0.0),))
    stands_in = "speed_dependent_damping:estimated"
    assert stands_in in [form.key for form in forms_for(told)]
    assert stands_in not in [form.key for form in forms_for(untold)]
    assert stands_in not in [form.key for form in forms_for(told, SPEEDS[:1])]
    # Twin screws push ahead, whether that is told or not; one beside the other across the hull does not.
    twins = replace(untold, thrusters=(*untold.thrusters, replace(untold.thrusters[0], name="port", arm=-0.4)))
    assert stands_in in [form.key for form in forms_for(twins)]
    np.testing.assert_array_equal(twins.surge_shares, [1.0, 1.0])
    across = replace(untold, thrusters=(*untold.thrusters, replace(untold.thrusters[0], name="bow")))
    np.testing.assert_array_equal(across.surge_shares, [0.0, 0.0])


def test_terms_see_the_mean_speed_of_each_interval() -> None:
    effect = effect_named("speed_dependent_damping")
    curve = ThrustCurve(command=np.array([-1.0, 1.0]), thrust=np.array([-9.0, 9.0]))
    vehicle = Vehicle(name="boat", thrusters=(Thruster(name="aft", arm=0.4, curve=curve),))
    time = np.array([0.0, 1.0, 2.0, 4.0])
    log = replace(trial(time, np.zeros(4)), extras={SPEEDS[0]: np.array([np.nan, 1.0, 3.0, 2.0])})
    model = Model(inertia=1.0, quadratic_drag=0.0, linear_drag=1.0, effects=(effect,), effect_values=(1.0,))
    drive = model.torque_input(vehicle, log)
    np.testing.assert_allclose(drive.effect_inputs[:, 1], [1.0, 2.0, 2.5, 2.0])
    joined = TorqueInput.averaged_over(
        Intervals.from_times([time], [np.array([0, 1, 3])]), drive.torque, drive.effect_inputs
    )
    np.testing.assert_allclose(joined.effect_inputs[:, 1], [1.0, 7.0 / 3.0, 2.0])
    # Where it is not logged, as in a run to come, that of the campaign goes.
    planned = replace(log, extras={}, reference={SPEEDS[0]: 1.5})
    np.testing.assert_allclose(model.torque_input(vehicle, planned).effect_inputs[:, 1], 1.5)
    assert not TorqueInput.held(np.zeros(3)).effect_inputs.any()


@pytest.mark.parametrize(
    ("key", "values", "torque"),
    [
        ("speed_dependent_damping", (3.0,), -3.0 * 0.8 * 0.2),
        ("speed_dependent_damping:quadratic", (3.0,), -3.0 * 0.64 * 0.2),
        ("speed_dependent_damping:both", (3.0, 5.0), -(3.0 * 0.8 + 5.0 * 0.64) * 0.2),
        ("sideslip_moment", (3.0,), 3.0 * 0.2),
        ("sideslip_moment:munk", (3.0,), 3.0 * 0.8 * 0.2),
        ("sideslip_moment:both", (3.0, 5.0), (3.0 + 5.0 * 0.8) * 0.2),
    ],
)
def test_speeds_give_torque(key: str, values: tuple[float, ...], torque: float) -> None:
    from tests.effects.test_effects import term

    assert term(effect_named(key), np.array(values), 0.2, 0.0, np.zeros(2))[0] == pytest.approx(torque)


def test_thrust_loss_by_the_speed_along_the_thruster() -> None:
    effect = effect_named("advance_speed_loss:measured")
    assert isinstance(effect.acts, OnThrust)
    where = replace(WHERE, extras={SPEEDS[0]: np.full(len(WHERE.time), 2.0)}, forward_share=np.array([1.0, -0.5]))
    thrust = np.tile([100.0, -25.0], (len(WHERE.time), 1))
    found = effect.acts.change(where, thrust, {"coefficient": 0.5})[0]
    np.testing.assert_allclose(found, [100.0 - 0.5 * 10.0 * 2.0, -25.0 + 0.5 * 5.0 * 2.0 * 0.5])
    # Where nothing is told of the thrusters they are taken to push ahead.
    untold = effect.acts.change(replace(where, forward_share=np.zeros(2)), thrust, {"coefficient": 0.5})[0]
    np.testing.assert_allclose(untold, [90.0, -25.0 - 5.0])


def test_thrust_loss_across_the_flow() -> None:
    effect = effect_named("advance_speed_loss:across")
    assert isinstance(effect.acts, OnThrust)
    thrust = np.tile([100.0, -25.0], (len(WHERE.time), 1))
    for speed in (2.0, -2.0):
        where = replace(WHERE, extras={SPEEDS[0]: np.full(len(WHERE.time), speed)})
        np.testing.assert_allclose(effect.acts.change(where, thrust, {"coefficient": 0.5})[0], [90.0, -20.0])
        np.testing.assert_array_equal(effect.acts.change(where, thrust, {"coefficient": 9.0})[0], [0.0, 0.0])


@pytest.mark.parametrize(
    ("key", "values", "expected"),
    [
        ("sideslip_moment:estimated", (3.0, 2.0, 5.0), -3.0 * 0.3),
        ("sideslip_moment:carried", (3.0, 2.0), -3.0 * 0.8 * 0.3),
    ],
)
def test_estimated_sideslip_decays(key: str, values: tuple[float, ...], expected: float) -> None:
    from tests.effects.test_effects import term

    # With the speed of 0.8 that the helper has, at a rate of 0.2.
    torque, change = term(effect_named(key), np.array(values), 0.2, 0.0, np.array([0.3, 0.0]))
    assert torque == pytest.approx(expected)
    assert change[0] == pytest.approx((-0.8 * 0.2 - 0.3) / 2.0)


def test_sway_of_a_turn_opposes_the_turn_with_a_lag() -> None:
    from tests.effects.test_effects import term

    torque, change = term(effect_named("sideslip_moment:turning"), np.array([3.0, 2.0]), 0.2, 0.0, np.array([0.3, 0.0]))
    assert torque == pytest.approx(-3.0 * 0.3)
    assert change[0] == pytest.approx((0.2 - 0.3) / 2.0)


def test_friction_may_differ_between_directions() -> None:
    from tests.effects.test_effects import term

    effect, values = effect_named("coulomb_resistance:unequal"), np.array([2.0, 3.0, 10.0, 0.01])
    assert term(effect, values, 0.5, 0.0, np.zeros(2))[0] == pytest.approx(-2.0)
    assert term(effect, values, -0.5, 0.0, np.zeros(2))[0] == pytest.approx(3.0 + 5.0)


def test_the_command_form_keeps_range_and_dead_zone() -> None:
    effect = effect_named("thrust_curve_shape:command")
    assert isinstance(effect.acts, OnCommand)
    command = np.array([[0.2, -5.0], [5.0, -0.3], [0.3 + 0.25 * 4.7, -(0.3 + 0.25 * 4.7)]])
    found = effect.acts.change(WHERE, command, {"exponent": 1.5})
    bent = 0.3 + 0.125 * 4.7
    np.testing.assert_allclose(found, [[0.0, -5.0], [5.0, 0.0], [bent, -bent]])
