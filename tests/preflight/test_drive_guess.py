"""Guess of rudders, steered wheels, bench motors and orders to rate controllers."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.preflight.raw_columns import RawColumn
from rovid.preflight.signal_guess import map_columns
from rovid.preflight.thruster_guess import GuessHints
from tests.conftest import SAMPLES, Rovid


def levels(rng: np.random.Generator, size: float, count: int, hold: int) -> FloatArray:
    """``count`` random levels within ``size``, each held for ``hold`` samples."""
    return np.repeat(rng.uniform(-size, size, count), hold)


def moved(torque: FloatArray, step: float, inertia: float, quadratic: float, linear: float) -> FloatArray:
    """(2, n) rate and position of inertia and drag under a held torque, in steps of a fiftieth of ``step`` in s."""
    rate, position, rows = 0.0, 0.0, []
    for value in torque.tolist():
        rows.append((rate, position))
        for _ in range(50):
            before = rate
            rate += step / 50.0 / inertia * (value - quadratic * abs(rate) * rate - linear * rate)
            position += step / 100.0 * (before + rate)
    return np.array(rows).T


def lag(values: FloatArray, share: float) -> FloatArray:
    """``values`` behind a lag of first order; each step closes ``share`` of the distance."""
    state, late = values[0], []
    for value in values.tolist():
        late.append(state)
        state += share * (value - state)
    return np.array(late)


def write(folder: Path, columns: Mapping[str, FloatArray]) -> None:
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "run.csv", table, fmt="%.8g", delimiter=",", header=",".join(columns), comments="")


def boat(folder: Path, *, one_way: bool = False) -> None:
    rng = np.random.default_rng(21)
    angle, speed = levels(rng, 30.0, 60, 60), lag(np.abs(levels(rng, 1.5, 18, 200)) + 0.5, 0.03)
    angle = np.abs(angle) if one_way else angle
    rate, heading = moved(-40.0 * speed**2 * np.radians(angle), 0.1, 300.0, 120.0, 15.0)
    compass = np.degrees(heading) + 0.05 * rng.standard_normal(len(rate))
    columns = {"t_s": 0.1 * np.arange(len(rate)), "e_heading": 180.0 - compass % 360.0, "hdg_deg": compass % 360.0}
    write(folder, columns | {"helm_deg": angle, "sog_kn": speed / 0.514444, "prop_rpm": 800.0 * speed})


def car(folder: Path) -> None:
    rng = np.random.default_rng(22)
    angle, speed = levels(rng, 0.35, 80, 30), lag(np.abs(levels(rng, 4.0, 24, 100)), 0.1)
    yaw = np.cumsum(0.05 * lag(speed * np.tan(angle) / 1.1, 0.4)) + 0.003 * rng.standard_normal(len(angle))
    columns = {"stamp": 0.05 * np.arange(len(yaw)), "yaw": np.remainder(yaw, 2.0 * np.pi), "yaw_error": np.sin(yaw)}
    write(folder, columns | {"steering_angle": -angle, "vel_mps": speed})


def motor(folder: Path) -> None:
    rng = np.random.default_rng(23)
    current = levels(rng, 3.0, 100, 40)
    rate, _ = moved(0.05 * current, 0.01, 2e-4, 0.0, 1e-3)
    speed = rate * 30.0 / np.pi + 2.0 * rng.standard_normal(len(rate))
    columns = {"time": 0.01 * np.arange(len(rate)), "rpm": speed, "motor_current_A": current}
    write(folder, columns | {"bus_voltage": np.full(len(rate), 24.0)})


def servo(folder: Path) -> None:
    rng = np.random.default_rng(24)
    order = levels(rng, 100.0, 80, 60)
    speed = lag(order, 0.15) + 0.3 * rng.standard_normal(len(order))
    columns = {"time_s": 0.01 * np.arange(len(order)), "omega_ref_rad_s": order, "omega_rad_s": speed}
    write(folder, columns | {"iq_A": np.gradient(speed)})


def surveyed(folder: Path, rovid: Rovid, *options: str) -> dict[str, Any]:
    """The rovid.toml that `rovid init` writes."""
    assert rovid("init", folder, *options).code == 0
    return tomllib.loads((folder / "rovid.toml").read_text(encoding="utf-8"))


def test_a_boat_has_a_rudder_with_the_sense_of_its_motion(tmp_path: Path, rovid: Rovid) -> None:
    boat(tmp_path)
    written = surveyed(tmp_path, rovid)
    (rudder,) = written["rudders"]
    assert rudder == {
        "name": "rudder",
        "angle": {"csv": "helm_deg", "unit": "deg", "sign": -1},
        "speed": "surge_velocity",
    }
    assert written["signals"]["surge_velocity"] == {"csv": "sog_kn", "unit": "kn"}
    assert written["signals"]["heading"]["csv"] == "hdg_deg"
    assert "thrusters" not in written
    assert rovid("check", tmp_path).code == 0
    document = rovid("fit", tmp_path, "-p", tmp_path / "p.toml", "--json").document
    values = {name: one["value"] for name, one in document["parameters"].items()}
    # The scale of the torque cancels; 1 %: the steps of the simulation.
    assert values["inertia"] / values["quadratic_drag"] == pytest.approx(300.0 / 120.0, rel=0.01)


@pytest.mark.parametrize("one_way", [False, True])
def test_a_rudder_is_asked_for_a_zigzag_where_there_is_none(one_way: bool, tmp_path: Path, rovid: Rovid) -> None:
    boat(tmp_path, one_way=one_way)
    surveyed(tmp_path, rovid)
    advice = {one["kind"]: one["text"] for one in rovid("check", tmp_path, "--json").document["advice"]}
    assert ("sines" in advice) == one_way
    assert not one_way or advice["sines"].startswith("Steer a zigzag with 3 reversals")
    assert "rudder amidships in a turn" in advice["coast"]


def test_a_boat_with_surge_and_sway_is_told_of_the_coupled_model(tmp_path: Path, rovid: Rovid) -> None:
    boat(tmp_path)
    assert "--axes planar" not in rovid("init", tmp_path).out
    log = np.genfromtxt(tmp_path / "run.csv", delimiter=",", names=True)
    names = list(log.dtype.names or ())
    rng = np.random.default_rng(22)
    write(tmp_path, {name: log[name] for name in names} | {"sway_m_s": 0.1 * rng.standard_normal(len(log))})
    assert "These logs also hold surge and sway" in rovid("init", tmp_path, "--force").out


def test_a_car_has_steered_wheels_and_no_inertia(tmp_path: Path, rovid: Rovid) -> None:
    car(tmp_path)
    (wheels,) = surveyed(tmp_path, rovid)["rudders"]
    assert wheels["angle"] == {"csv": "steering_angle", "unit": "rad", "sign": -1}
    assert wheels["wheelbase"] == pytest.approx(1.1, rel=0.05)
    assert wheels["wheelbase_guessed"] == wheels["wheelbase"]
    for command in ("fit", "diagnose"):
        refused = rovid(command, tmp_path, "-p", tmp_path / "p.toml")
        assert refused.code != 0
        assert "steers wheels" in refused.err


def test_a_motor_has_a_torque_constant(tmp_path: Path, rovid: Rovid) -> None:
    motor(tmp_path)
    written = surveyed(tmp_path, rovid)
    assert written["signals"]["yaw_rate"] == {"csv": "rpm", "unit": "rpm"}
    (thruster,) = written["thrusters"]
    assert thruster["command"] == {"csv": "motor_current_A"}
    assert thruster["torque_constant"] == thruster["torque_constant_guessed"] == 1.0
    assert rovid("check", tmp_path).code == 0
    document = rovid("fit", tmp_path, "-p", tmp_path / "p.toml", "--json").document
    values = {name: one["value"] for name, one in document["parameters"].items()}
    assert values["inertia"] / values["linear_drag"] == pytest.approx(0.2, rel=0.01)


def test_a_speed_order_is_one_and_the_current_is_suggested(tmp_path: Path, rovid: Rovid) -> None:
    servo(tmp_path)
    document = rovid("init", tmp_path, "--json").document
    signals = {name: one["source"] for name, one in document["signals"]["csv"].items()}
    assert signals == {"yaw_rate": "omega_rad_s", "yaw_rate_order": "omega_ref_rad_s"}
    (warning,) = document["warnings"]
    assert '--heading "omega_rad_s" --command "iq_A"' in warning
    assert "order to a controller" in rovid("fit", tmp_path, "-p", tmp_path / "p.toml").err
    written = surveyed(tmp_path, rovid, "--heading", "omega_rad_s", "--command", "iq_A", "--force")
    assert written["thrusters"][0]["command"] == {"csv": "iq_A"}
    assert "yaw_rate_order" not in written["signals"]


@pytest.mark.parametrize(
    ("sample", "refusal"),
    [("f110_car", "steers wheels"), ("robotino_motors", "order to a controller"), ("bldc_bench", "")],
)
def test_real_logs_of_other_fields_need_no_editing(sample: str, refusal: str, tmp_path: Path, rovid: Rovid) -> None:
    shutil.copytree(SAMPLES / sample, tmp_path / "logs", ignore=shutil.ignore_patterns("rovid.toml"))
    assert rovid("init", tmp_path / "logs").code == 0
    done = rovid("fit", tmp_path / "logs", "-p", tmp_path / "p.toml")
    assert refusal in done.err
    assert bool(done.code) == bool(refusal)
    if sample == "f110_car":  # The angle of the IMU comes before the orientation of the odometry.
        assert 'heading = { csv = "phi_y"' in (tmp_path / "logs" / "rovid.toml").read_text()


# ---- names

TIME = np.arange(0.0, 400.0, 0.1)
ANGLE = levels(np.random.default_rng(3), 0.4, 20, 200)
SPEED = 1.0 + np.abs(levels(np.random.default_rng(4), 1.0, 40, 100))
HEADING = np.cumsum(0.1 * lag(SPEED**2 * ANGLE, 0.03))


def log(**columns: FloatArray) -> dict[str, RawColumn]:
    return {name: RawColumn(source=name, time=TIME, values=values) for name, values in columns.items()}


def test_a_rudder_needs_a_speed_and_the_question_names_the_option() -> None:
    columns = log(heading=HEADING, rudder_angle=ANGLE, flow=SPEED)
    found = map_columns([columns])
    assert found.missing == ("command",)
    (question,) = found.remarks
    assert '--command "rudder_angle,SPEED"' in question
    assert question.endswith("one of flow.")
    (rudder,) = map_columns([columns], GuessHints(commands=("rudder_angle", "flow"))).rudders
    assert (rudder.angle.source, rudder.angle.sign) == ("rudder_angle", 1)


@pytest.mark.parametrize("name", ["rudder_error", "delta_t", "rudder_rate", "delta_psi", "rudder_effort"])
def test_other_quantities_are_no_angle(name: str) -> None:
    found = map_columns([log(heading=HEADING, **{name: ANGLE}, speed=SPEED)])
    assert found.rudders == ()


@pytest.mark.parametrize(
    ("names", "speed"),
    [
        (("speed", "speed_ref"), "speed"),
        (("V", "u_wind_speed"), "V"),
        (("vx", "speed"), "vx"),
        (("speed_cmd", "rpm"), "speed_cmd"),
    ],
)
def test_the_measured_speed_ahead_comes_first(names: tuple[str, str], speed: str) -> None:
    still = SPEED - SPEED.min()
    found = map_columns([log(heading=HEADING, delta=ANGLE, **dict.fromkeys(names, still))])
    assert found.signals[found.rudders[0].speed].source == speed


def test_u_next_to_v_is_the_surge_velocity() -> None:
    found = map_columns([log(psi=HEADING, u=SPEED, v=0.1 * ANGLE, delta=ANGLE)])
    assert [rudder.speed for rudder in found.rudders] == ["surge_velocity"]
    assert found.signals["surge_velocity"].source == "u"
    found = map_columns([log(psi=HEADING, v_m_s=0.1 * ANGLE, u_m_s=SPEED, delta=ANGLE)])
    assert found.signals["surge_velocity"].source == "u_m_s"


def test_a_thruster_that_turns_the_vehicle_stays_next_to_a_rudder() -> None:
    thrust = levels(np.random.default_rng(9), 1.0, 80, 50)
    heading = HEADING + np.cumsum(0.1 * lag(thrust, 0.03))
    found = map_columns([log(heading=heading, rudder=ANGLE, speed=SPEED, bow_cmd=thrust, stern_cmd=np.roll(SPEED, 7))])
    assert [one.source for one in found.commands] == ["bow_cmd"]
    assert [one.angle.source for one in found.rudders] == ["rudder"]


def test_the_order_to_a_rudder_is_no_thruster() -> None:
    found = map_columns([log(heading=HEADING, rudder_command=np.sign(ANGLE) * 30.0 + 40.0, rudder=ANGLE, speed=SPEED)])
    assert [one.angle.source for one in found.rudders] == ["rudder"]
    assert found.commands == ()


def test_a_propeller_of_a_vehicle_is_no_bench_motor() -> None:
    found = map_columns([log(depth=SPEED, motor_rpm=900.0 * SPEED, motor_current=ANGLE)])
    assert "yaw_rate" not in found.signals
    assert "heading" in found.missing
