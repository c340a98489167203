"""Runs of the coupled model: readings at their own stamps through readers, faults and cuts; forces of all actuators."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.effects.catalogue import ANGLE_FORMS, effect_named
from rovid.model.bound_effects import BoundEffect
from rovid.planar.effect_fits import planar_candidates
from rovid.planar.model import SENSORS
from rovid.trial.config import load_config, load_planar_config
from tests.planar.campaign import CURVE, PORT_AND_STARBOARD, SIGNALS, Motion, read, stamps_of, write_campaign, write_log

SHARES = """
[[thrusters]]
name = "bow"
surge = 0.5
sway = 0.8660254037844386
yaw_arm = 0.2660254037844386
curve = "curve.csv"
command = "a"
"""
POSITION = """
[[thrusters]]
name = "bow"
position = [0.4, 0.16076951545867364]
direction = 60
curve = "curve.csv"
command = "a"
"""
POD = """
[[thrusters]]
name = "pod"
position = [-1.5, 0.25]
azimuth = { csv = "b", unit = "rad" }
curve = "curve.csv"
command = "a"
"""
SHIP = """
[[thrusters]]
name = "screw"
surge = 1.0
thrust_constant = 3.0
thrust_constant_guessed = 3.0
max_command = 20
diameter = 0.1
command = "a"
[[rudders]]
name = "helm"
position = [-1.5, 0.0]
area = 0.01
behind = "screw"
angle = { csv = "b", unit = "rad" }
"""


def configured(folder: Path, actuators: str, signals: str = SIGNALS) -> Path:
    (folder / "curve.csv").write_text(CURVE)
    path = folder / "rovid.toml"
    path.write_text(actuators + signals)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("planar")
    write_campaign(made)
    return made


def test_every_reading_stands_at_its_own_stamp(folder: Path) -> None:
    data, motion = read(folder), Motion(seed=0)
    run = data.runs[0]
    assert data.sensors == SENSORS
    assert np.all(np.diff(run.time) > 0.0)
    assert np.all(np.diff(run.event_index) >= 0)
    for name, column, unit in (("heading", "hdg", math.pi / 180), ("surge_velocity", "u", 1.0), ("east", "e", 1.0),
                               ("sway_velocity", "v", 0.01), ("yaw_rate", "gyro", math.pi / 180)):  # fmt: skip
        stamps = stamps_of({"east": "north", "yaw_rate": "heading"}.get(name, name.replace("sway", "surge")), 120.0)
        if "velocity" in name:
            stamps = stamps[(stamps < 40.0) | (stamps >= 55.0)]
        readings = run.readings(name)
        # Stamps are rounded to 0.1 ms in the log, and closer ones share an instant.
        np.testing.assert_allclose(readings.time, stamps, atol=1.1e-4)
        np.testing.assert_allclose(readings.values, motion.at(column, stamps) * unit, atol=1e-4)


def test_readings_follow_a_cut(folder: Path, tmp_path: Path) -> None:
    excluded = '\n[[leave_out]]\nlog = "run_0.csv"\nfrom = 60.0\nto = 70.0\n'
    write_campaign(tmp_path, signals=SIGNALS + excluded, logs=1)
    whole, (before, after) = read(folder).runs[0], read(tmp_path).runs
    for name in SENSORS:
        complete, late = whole.readings(name), after.readings(name)
        start = 70.05  # s; the first heading after the interval
        kept = complete.time >= start
        assert len(late.time) == kept.sum()
        np.testing.assert_allclose(late.time + start, complete.time[kept], atol=1e-9)
        np.testing.assert_array_equal(late.values, complete.values[kept])
        assert before.readings(name).time.max() < 60.0


def test_readings_follow_a_clock_that_is_set_back(tmp_path: Path) -> None:
    write_campaign(tmp_path, logs=1)
    path = tmp_path / "run_0.csv"
    header, *rows = path.read_text().splitlines()
    shifted = []
    for row in rows:
        stamp, rest = row.split(",", 1)
        shifted.append(f"{float(stamp) - (0.9 if float(stamp) >= 80.0 else 0.0):.4f},{rest}")
    path.write_text("\n".join([header, *shifted]) + "\n")
    runs, motion = read(tmp_path).runs, Motion(seed=0)
    assert len(runs) == 2
    for name, column in (("surge_velocity", "u"), ("north", "n")):
        late = runs[1].readings(name)
        expected = stamps_of(name, 120.0)
        expected = expected[expected >= 80.0]
        np.testing.assert_allclose(late.values, motion.at(column, expected), atol=1e-4)
        np.testing.assert_allclose(np.diff(late.time), np.diff(expected), atol=2.1e-4)  # stamps of 0.1 ms


def test_position_and_direction_are_shares_and_an_arm(tmp_path: Path) -> None:
    vehicles = [load_planar_config(configured(tmp_path, text)).vehicle.thrusters[0] for text in (SHARES, POSITION)]
    for key in ("surge_share", "sway_share", "arm"):
        assert getattr(vehicles[0], key) == pytest.approx(getattr(vehicles[1], key), rel=1e-12)
    on_yaw = load_config(configured(tmp_path, POSITION)).vehicle.thrusters[0]
    assert on_yaw.arm == pytest.approx(vehicles[0].arm, rel=1e-12)
    ahead = POSITION.replace("= 60", "= 0").replace("0.16076951545867364", "0")
    with pytest.raises(ConfigError, match="none has yaw_arm"):  # A thruster on the centre line does not act in yaw.
        load_config(configured(tmp_path, ahead))


def test_a_pod_pushes_where_it_points(tmp_path: Path) -> None:
    write_campaign(tmp_path, POD, logs=1)
    run = read(tmp_path).runs[0]
    command, azimuth = run.trial.commands.T
    thrust = 40.0 * command
    ahead, starboard = thrust * np.cos(azimuth), thrust * np.sin(azimuth)
    expected = np.column_stack((ahead, starboard, -1.5 * starboard - 0.25 * ahead))
    np.testing.assert_allclose(run.forces().force, expected, atol=1e-12)
    with pytest.raises(ConfigError, match=r"azimuth: turns the thrust, .* Give --axes planar"):
        load_config(tmp_path / "rovid.toml")


@pytest.mark.parametrize("form", ["thruster_lag", "thruster_lag:command"])
def test_a_pod_turns_on_through_a_whole_turn(form: str, tmp_path: Path) -> None:
    motion, rate, lag = Motion(seed=0), 0.25, 0.8
    motion.commands["a"][:] = 1.0
    motion.commands["b"][:] = np.mod(rate * motion.time + math.pi, 2.0 * math.pi) - math.pi
    write_campaign(tmp_path, POD, logs=0)
    write_log(tmp_path / "run.csv", motion)
    run = read(tmp_path).runs[0]
    force = run.forces([BoundEffect(effect_named(form), np.array([lag]))]).force[:-1]
    middle = 0.5 * (run.time[:-1] + run.time[1:])
    late = middle > 8.0 * lag
    azimuth = np.unwrap(np.arctan2(force[late, 1], force[late, 0]))
    # Angles are logged to 0.01 rad, and held over intervals of 50 ms at most.
    np.testing.assert_allclose(azimuth, rate * (middle[late] - lag), atol=0.03)
    assert azimuth[-1] > 4.0 * math.pi


def test_a_rudder_keeps_its_angle_and_knows_its_screw(tmp_path: Path) -> None:
    signals = "\n".join(line for line in SIGNALS.splitlines() if not line.startswith(("surge", "sway")))
    write_campaign(tmp_path, SHIP, signals, logs=1)
    data = read(tmp_path)  # No speed is logged.
    run, rudder = data.runs[0], data.actuators.rudders[0]
    forces, (revolutions, angle) = run.forces(), run.trial.commands.T
    np.testing.assert_allclose(forces.force[:, 0], 3.0 * np.abs(revolutions) * revolutions, atol=0.1)  # curve's points
    np.testing.assert_allclose(forces.angle[:, 0], angle, atol=1e-12)
    np.testing.assert_array_equal(forces.slipstream_thrust[:, 0], forces.force[:, 0])
    np.testing.assert_array_equal(forces.force[:, 1:], 0.0)
    assert (rudder.position, rudder.behind, rudder.stall) == ((-1.5, 0.0), "screw", None)
    assert rudder.lift == pytest.approx(0.5 * 1000.0 * 0.01 * 2.45)
    assert rudder.slipstream == pytest.approx(2.0 / (1000.0 * math.pi * 0.05**2))


@pytest.mark.parametrize(
    ("effect", "size", "expected"),
    [
        ("slew_limit", 0.05, lambda time, angle: np.minimum(angle, 0.05 * np.maximum(time, 0.0))),
        ("command_delay", 0.5, lambda time, angle: np.where(time < 0.5, 0.0, angle)),
        ("thruster_lag", 2.0, lambda time, angle: angle * (1.0 - np.exp(-np.maximum(time, 0.0) / 2.0))),
        ("slew_limit:angle", 0.05, lambda time, angle: np.minimum(angle, 0.05 * np.maximum(time, 0.0))),
        ("thruster_lag:angle", 2.0, lambda time, angle: angle * (1.0 - np.exp(-np.maximum(time, 0.0) / 2.0))),
        ("thruster_deadband:angle", 0.1, lambda time, angle: np.maximum(angle - 0.1, 0.0)),
        ("command_hysteresis:angle", 0.1, lambda time, angle: np.maximum(angle - 0.05, 0.0)),
    ],
)
def test_the_gear_of_a_rudder_is_slow(
    effect: str, size: float, expected: Callable[..., FloatArray], tmp_path: Path
) -> None:
    motion = Motion(seed=0)
    motion.commands["a"][:] = 1.0
    motion.commands["b"][:] = np.where(motion.time < 60.0, 0.0, 0.4)
    write_campaign(tmp_path, SHIP, logs=0)
    write_log(tmp_path / "run.csv", motion)
    data = read(tmp_path)
    assert data.actuators.steered
    assert {one.unit for form in planar_candidates(data) for one in form.parameters}.isdisjoint(
        {"command", "command/s"}
    )
    run = data.runs[0]
    forces = run.forces([BoundEffect(effect_named(effect), np.array([size]))])
    # Means over intervals of 50 ms at most.
    middle = 0.5 * (run.time[:-1] + run.time[1:]) - 60.0
    away = np.abs(middle - (size if effect == "command_delay" else 0.0)) > 0.1
    angle = expected(middle, np.where(middle < 0.0, 0.0, 0.4))
    np.testing.assert_allclose(forces.angle[:-1, 0][away], angle[away], atol=1e-3)
    assert np.ptp(forces.force[:, 0]) < 1e-9


@pytest.mark.parametrize(
    ("effect", "size"),
    [(form.key, {"thruster_lag": 2.0, "slew_limit": 0.05}.get(form.id, 1.0)) for form in ANGLE_FORMS],
)
def test_a_slow_gear_leaves_thrust_as_it_is(effect: str, size: float, tmp_path: Path) -> None:
    write_campaign(tmp_path, SHIP, logs=1)
    data = read(tmp_path)
    assert not data.actuators.steered
    keys = {form.key for form in planar_candidates(data)}
    assert effect in keys
    assert "sideslip_moment:acceleration" not in keys  # the model has the coupled mass
    plain, slow = (data.runs[0].forces(one) for one in ((), [BoundEffect(effect_named(effect), np.array([size]))]))
    np.testing.assert_allclose(slow.force, plain.force, atol=1e-9)
    np.testing.assert_allclose(slow.slipstream_thrust, plain.slipstream_thrust, atol=1e-9)
    assert np.std(slow.angle - plain.angle) > 0.5 * np.std(plain.angle)


def test_a_yaw_rate_stands_in_for_a_heading(tmp_path: Path) -> None:
    signals = "\n".join(line for line in SIGNALS.splitlines() if not line.startswith("heading"))
    write_campaign(tmp_path, signals=signals, logs=1)
    run = read(tmp_path).runs[0]
    assert run.sensors == SENSORS[1:]
    assert len(run.readings("yaw_rate").time) == len(stamps_of("heading", 120.0))
    with pytest.raises(ConfigError, match="has no heading"):
        load_planar_config(configured(tmp_path, PORT_AND_STARBOARD, signals.replace("yaw_rate", "gyro")))


@pytest.mark.parametrize("effect", ["thruster_lag", "command_delay", "thruster_deadband", "slew_limit"])
def test_an_effect_acts_on_each_thruster_as_on_one_axis(effect: str, folder: Path) -> None:
    data, values = (
        read(folder),
        {"thruster_lag": 0.7, "command_delay": 0.33, "thruster_deadband": 0.2, "slew_limit": 0.5},
    )
    run, bound = data.runs[0], BoundEffect(effect_named(effect), np.array([values[effect]]))
    forces, plain = run.forces([bound]), run.forces()
    turning = bound_torque(run.trial, data.vehicle, bound)
    np.testing.assert_allclose(forces.force[:, 2], turning, atol=2e-3 * np.abs(turning).max())  # parts of an interval
    assert np.abs(forces.force - plain.force).max() > 1.0


def bound_torque(trial: object, vehicle: object, bound: BoundEffect) -> np.ndarray:
    from rovid.model.actuator_model import ActuatorModel

    return ActuatorModel((bound,)).torque_input(vehicle, trial).torque  # type: ignore[arg-type]  # as in yaw alone


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("surge = 1.0\nyaw_arm = 0.3\n", "", r"'port': has no surge, sway or yaw_arm\."),
        ("surge = 1.0\nyaw_arm = 0.3\n", "position = [0.1, 0.2]\n", r"'port': has a position and no direction"),
        ("surge = 1.0\nyaw_arm = 0.3\n", "position = 0.1\n", r"'port': has a position and no direction"),
        ("yaw_arm = 0.3\n", "position = 0.1\n", r"'port' position: is 0\.1; two numbers in m"),
        ("yaw_arm = 0.3\n", "direction = 0\n", r"'port': has direction and surge; one of them"),
        ("surge = 1.0\nyaw_arm = 0.3\n", 'azimuth = "b"\n', r"'port': has an azimuth and no position"),
    ],
)
def test_a_thruster_without_a_place_is_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=message):
        load_planar_config(configured(tmp_path, PORT_AND_STARBOARD.replace(old, new, 1)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('angle = { csv = "b", unit = "rad" }\n', "", "'helm': has no angle"),
        ("position = [-1.5, 0.0]\n", "", "'helm': has no position"),
        ('behind = "screw"', 'behind = "skrew"', "'helm' behind: is 'skrew'; the name of a thruster .*: screw"),
        ("area = 0.01", "area = -1", "'helm' area: is -1"),
        ("area = 0.01", "wheelbase = 1", "'helm': is steered wheels"),
    ],
)
def test_a_rudder_without_a_place_is_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=message):
        load_planar_config(configured(tmp_path, SHIP.replace(old, new)))


@pytest.mark.parametrize("gyro", [True, False])
def test_sensors_away_from_the_origin_read_as_if_at_it(tmp_path: Path, gyro: bool) -> None:
    """A step of a command bends the yaw rate, which is interpolated or smoothed there: hence the RMS error counts."""
    plain, moved, (x, y) = Motion(), Motion(), (0.8, -0.3)
    psi, r = np.radians(plain.columns["hdg"]), np.radians(plain.columns["gyro"])
    moved.columns["n"] = plain.columns["n"] + x * np.cos(psi) - y * np.sin(psi)
    moved.columns["e"] = plain.columns["e"] + x * np.sin(psi) + y * np.cos(psi)
    moved.columns["u"], moved.columns["v"] = plain.columns["u"] - y * r, plain.columns["v"] + 100.0 * x * r
    signals = SIGNALS if gyro else SIGNALS.replace("yaw_rate", "spare").replace(', unit = "deg/s"', "")
    for name in ("north", "east", "surge_velocity", "sway_velocity"):
        signals = signals.replace(f"{name} = {{", f"{name} = {{ position = [{x}, {y}],")
    write_campaign(tmp_path, signals=signals, logs=0)
    write_log(tmp_path / "run.csv", moved)
    run = read(tmp_path).runs[0]
    for name, column in (("north", "n"), ("east", "e"), ("surge_velocity", "u"), ("sway_velocity", "v")):
        readings, factor = run.readings(name), 0.01 if column == "v" else 1.0
        inner = (readings.time > 1.0) & (readings.time < 119.0)  # The kernel has both sides.
        wrong = (readings.values - factor * plain.at(column, readings.time))[inner]
        # Over 50 ms the heading bends by 3.4e-4 rad at most. The rate is off by 0.05 % and 4 % of its RMS value.
        most = 3e-4 if column in {"n", "e"} else (0.001 if gyro else 0.05) * np.sqrt(np.mean(r**2)) * np.hypot(x, y)
        assert np.sqrt(np.mean(wrong**2)) < most, name


def test_north_and_east_have_one_position(tmp_path: Path) -> None:
    path = configured(tmp_path, PORT_AND_STARBOARD, SIGNALS.replace('{ csv = "n"', '{ position = [1, 0], csv = "n"'))
    with pytest.raises(ConfigError, match="different positions"):
        load_planar_config(path)
