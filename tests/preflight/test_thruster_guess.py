"""Guesses of thrusters from names, autopilot parameters and the motion."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.preflight.raw_columns import RawColumn, columns_by_source
from rovid.preflight.signal_guess import map_columns
from rovid.preflight.thruster_guess import GuessHints, ThrusterCommand, guess_thrusters, thruster_outputs, vehicle_type
from rovid.trial.vehicle_presets import load_preset

# A submarine with four motors about the vertical and two for depth, the lights on 13.
SUB = {
    "FRAME_CONFIG": 1.0,
    **{f"SERVO{at}_FUNCTION": 32.0 + at for at in range(1, 7)},
    "SERVO13_FUNCTION": 59.0,
    **{f"MOT_{at}_DIRECTION": way for at, way in zip(range(1, 7), (-1, -1, 1, 1, -1, 1), strict=True)},
}


def test_directions_of_ardusub_follow_frame_and_parameters() -> None:
    outputs = thruster_outputs(SUB)
    senses = {source: output.direction for source, output in outputs.items() if source.startswith("RCOU")}
    assert senses == {f"RCOU.C{at}": way for at, way in zip(range(1, 7), (-1, 1, -1, 1, 0, 0), strict=True)}
    assert outputs["SERVO_OUTPUT_RAW.servo2_raw"] == outputs["RCOU.C2"]
    assert outputs["RCOU.C3"].name == "motor_3"
    assert vehicle_type(SUB) == "bluerov2"


def test_a_reversed_output_changes_the_direction() -> None:
    assert thruster_outputs({**SUB, "SERVO2_REVERSED": 1.0})["RCOU.C2"].direction == -1
    assert thruster_outputs({**SUB, "MOT_2_DIRECTION": 1.0})["RCOU.C2"].direction == -1


def test_motors_are_found_on_any_output() -> None:
    moved = {**SUB, "SERVO1_FUNCTION": 0.0, "SERVO15_FUNCTION": 33.0}
    assert "RCOU.C1" not in thruster_outputs(moved)
    assert thruster_outputs(moved)["RCO2.C15"].label == "1"


def test_throttles_of_a_boat_are_thrusters() -> None:
    outputs = thruster_outputs({"SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0})
    assert [(outputs[f"RCOU.C{at}"].name, outputs[f"RCOU.C{at}"].direction) for at in (1, 3)] == [
        ("port", 1),
        ("starboard", -1),
    ]


def test_px4_arms_follow_the_rotor_positions() -> None:
    rotors = [(0.2, 0.1, 0.7, -0.7), (0.0, 0.3, 1.0, 0.0), (0.0, 0.0, 0.0, 0.0)]
    parameters = {"CA_ROTOR_COUNT": float(len(rotors))}
    for at, values in enumerate(rotors):
        parameters |= {f"CA_ROTOR{at}_{what}": one for what, one in zip(("PX", "PY", "AX", "AY"), values, strict=True)}
    outputs = thruster_outputs(parameters)
    # Ahead and to starboard, pushing ahead and to port: both turn it to port.
    assert outputs["actuator_motors.control[0]"].direction == -1
    assert outputs["actuator_motors.control[0]"].arm == pytest.approx(0.21)
    assert (outputs["actuator_motors.control[1]"].direction, outputs["actuator_motors.control[2]"].direction) == (-1, 0)


@pytest.mark.parametrize("odd", [{}, {"FRAME_CONFIG": float("nan")}, {"FRAME_CONFIG": 1e30, "SERVO1_FUNCTION": 33.0}])
def test_invalid_parameters_are_ignored(odd: dict[str, float]) -> None:
    assert thruster_outputs(odd) == {}
    assert not vehicle_type(odd)


TIME = np.arange(0.0, 60.0, 0.1)
RNG = np.random.default_rng(5)


def held(low: float = -1.0, high: float = 1.0) -> FloatArray:
    return np.repeat(RNG.uniform(low, high, 20), 30)


def commands(wanted: GuessHints | None = None, **columns: FloatArray) -> dict[str, ThrusterCommand]:
    return of({name.replace("__", "."): values for name, values in columns.items()}, wanted)


def of(columns: dict[str, FloatArray], wanted: GuessHints | None = None) -> dict[str, ThrusterCommand]:
    log = {name: RawColumn(source=name, time=TIME, values=values) for name, values in columns.items()}
    found = guess_thrusters(columns_by_source([log]), [log], None, wanted or GuessHints())
    return {one.source: one for one in found}


@pytest.mark.parametrize(
    "names",
    [
        ("port", "stbd"), ("T1", "T2"), ("u1", "u2"), ("M1", "M2"), ("port_rpm", "starboard_rpm"), ("thr_1", "thr_2"),
        ("Schub links", "Schub rechts"), ("moteur_bâbord", "moteur_tribord"), ("fore_V", "aft_V"), ("left", "right"),
        ("RCIN.C1", "RCIN.C2"), ("ch1_us", "ch2_us"), ("Bugstrahlruder", "Heckstrahlruder"),
        ("Bugstrahl", "Heckstrahl"),
        ("Drehzahl Backbord", "Drehzahl Steuerbord"), ("propulseur étrave", "propulseur poupe"),
        ("tension_bâbord", "tension_tribord"), ("baugthruster", "hekkthruster"), ("elica_sinistra", "elica_dritta"),
        ("hélice babor", "hélice estribor"),
    ],
)  # fmt: skip
def test_common_names_are_recognised(names: tuple[str, str]) -> None:
    rates = {"thr.taux_de_giration_dps": held(), "thr.drehrate_dps": held(), "thr.lacet (°/s)": held()}
    other = {
        **rates,
        "thr.lacet_deg": held(),
        "thr.compass_rad": held(),
        "t": TIME,
        "port_temp": held(),
        "stbd_current": held(),
        "port_amps_A": held(),
        "depth": held(),
    }
    assert set(of({**other, names[0]: held(), names[1]: held()})) == set(names)


def test_lights_and_outputs_without_a_neutral_value_are_no_thrusters() -> None:
    pulses = {"RCOU.C1": held(1300.0, 1700.0), "RCOU.C2": held(1300.0, 1700.0), "RCOU.C10": held(1600.0, 1700.0)}
    lights = {"lights_pwm": held(1100.0, 1900.0), "camera_tilt_pwm": held(1100.0, 1900.0)}
    assert set(of(pulses | lights)) == {"RCOU.C1", "RCOU.C2"}


def test_the_yaw_demand_of_the_autopilot_determines_the_directions() -> None:
    one, two, depth = held(-100.0, 100.0), held(-100.0, 100.0), held(-100.0, 100.0)
    outputs = {"RCOU.C1": 1500.0 - one + two, "RCOU.C2": 1500.0 + one + two, "RCOU.C5": 1500.0 + depth}
    found = of({**outputs, "RATE.YOut": one / 400.0})
    assert {source: command.direction for source, command in found.items()} == {
        "RCOU.C1": -1,
        "RCOU.C2": 1,
        "RCOU.C5": 0,
    }


def test_a_type_of_vehicle_determines_direction_and_arm() -> None:
    found = commands(GuessHints(profile=load_preset("heron")), port_cmd=held(), stbd_cmd=held())
    assert {source: command.direction * command.arm for source, command in found.items()} == {
        "port_cmd": 0.378,
        "stbd_cmd": -0.378,
    }


def test_the_angle_of_an_azimuth_thruster_is_no_command() -> None:
    columns = {"fore_cmd": held(), "fore_az": held(-170.0, 170.0), "aft_cmd": held(), "aft_azimuth": held(-90.0, 90.0)}
    assert set(of(columns)) == {"fore_cmd", "aft_cmd"}
    found = map_columns([{name: RawColumn(source=name, time=TIME, values=values) for name, values in columns.items()}])
    (remark,) = found.remarks
    assert remark.startswith("fore_az")


def test_a_vertical_acceleration_is_no_azimuth() -> None:
    columns = {name: held(-9.0, 9.0) for name in ("ax", "ay", "az")} | {"fore_cmd": held(), "aft_cmd": held()}
    found = map_columns([{name: RawColumn(source=name, time=TIME, values=values) for name, values in columns.items()}])
    assert not found.remarks
    assert {one.source for one in found.commands} == {"fore_cmd", "aft_cmd"}


def test_named_commands_are_used() -> None:
    assert set(commands(GuessHints(commands=("a", "b")), a=held(), b=held(), port_cmd=held())) == {"a", "b"}


def test_thruster_commands_are_preferred_to_motion_commands() -> None:
    assert set(commands(yaw_cmd_norm=held(), pwm1_us=held(1300.0, 1700.0))) == {"pwm1_us"}
    assert set(commands(yaw_cmd_norm=held())) == {"yaw_cmd_norm"}
