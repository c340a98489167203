"""Thrusters and their directions from the parameters of autopilots."""

from __future__ import annotations

import pytest

from rovid.preflight.thruster_guess import thruster_outputs, vehicle_type

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
