"""What an autopilot's own parameters say of the vehicle: which outputs are thrusters, and which way they turn it.

ArduPilot: SERVOn_FUNCTION says what output n drives (33 to 40 and 82 to 85 are motors 1 to 12, 73 and 74 the throttles
to port and to starboard); FRAME_CONFIG how the motors of a submarine stand; MOT_n_DIRECTION and SERVOn_REVERSED
which way round they run. PX4: CA_ROTORn_PX, _PY, _AX, _AY, _CT say where each motor stands and where it pushes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# ArduSub's FRAME_CONFIG -> sense in which each motor turns the bow to starboard; the others do not turn it.
# Source: the table of motors in ArduPilot's AP_Motors6DOF.
_VECTORED = {1: 1, 2: -1, 3: -1, 4: 1}
_FRAMES: Mapping[int, Mapping[int, int]] = {
    0: {1: -1, 2: 1},
    1: _VECTORED,
    2: _VECTORED,
    3: {2: 1, 7: -1},
    4: {1: -1, 2: 1},
    5: {1: -1, 2: 1},
    6: {1: -1, 2: 1},
}
_FRAME = "FRAME_CONFIG"
# Frames that one type of vehicle has.
_TYPES = {1: "bluerov2", 2: "bluerov2-heavy"}
_MOTORS = {**{33 + at: 1 + at for at in range(8)}, **{82 + at: 9 + at for at in range(4)}}
_THROTTLES = {73: ("port", 1), 74: ("starboard", -1)}
_OUTPUTS = 16


@dataclass(frozen=True, kw_only=True)
class AutopilotOutput:
    """A thruster that the log itself names.

    Attributes
    ----------
    label
        The number of the motor, or the side that it stands on.
    way
        Sense in which more of the command turns the heading; 0 where it does not.
    arm
        m; 0 where that is not told.
    why
        What it was told by.
    """

    label: str
    direction: int
    reason: str
    arm: float = 0.0

    @property
    def name(self) -> str:
        """For people."""
        return f"motor_{self.label}" if self.label.isdigit() else self.label


def thruster_outputs(parameters: Mapping[str, float]) -> dict[str, AutopilotOutput]:
    """Source -> the thruster that it commands; empty where the parameters do not tell."""
    return _of_px4(parameters) or _of_ardupilot(parameters)


def vehicle_type(parameters: Mapping[str, float]) -> str:
    """The type of vehicle that the parameters tell; empty where they do not."""
    return _TYPES.get(_whole(parameters, _FRAME, -1), "")


def _whole(parameters: Mapping[str, float], name: str, other: int) -> int:
    value = parameters.get(name, other)
    return int(value) if abs(value) < 1e6 else other


def _of_ardupilot(parameters: Mapping[str, float]) -> dict[str, AutopilotOutput]:
    senses = _FRAMES.get(_whole(parameters, _FRAME, -1))
    outputs = {}
    for number in range(1, _OUTPUTS + 1):
        key = f"SERVO{number}_FUNCTION"
        function = _whole(parameters, key, 0)
        turned = -1 if _whole(parameters, f"SERVO{number}_REVERSED", 0) else 1
        if function in _THROTTLES:
            side, way = _THROTTLES[function]
            output = AutopilotOutput(
                label=side, direction=way * turned, reason=f"{key} is {function}, the throttle to {side}"
            )
        elif function in _MOTORS and senses is not None:
            motor = _MOTORS[function]
            direction = 1 if parameters.get(f"MOT_{motor}_DIRECTION", 1.0) >= 0.0 else -1
            told = f"{key} is {function}, motor {motor}; by {_FRAME} and MOT_{motor}_DIRECTION"
            output = AutopilotOutput(label=str(motor), direction=senses.get(motor, 0) * direction * turned, reason=told)
        else:
            continue
        for source in _sources(number):
            outputs[source] = output
    return outputs


def _sources(number: int) -> tuple[str, ...]:
    """Of output ``number``, in logs and in telemetry."""
    logged = f"RCOU.C{number}" if number <= 14 else f"RCO2.C{number}"
    return logged, f"SERVO_OUTPUT_RAW.servo{number}_raw"


def _of_px4(parameters: Mapping[str, float]) -> dict[str, AutopilotOutput]:
    outputs = {}
    for at in range(_whole(parameters, "CA_ROTOR_COUNT", 0)):
        x, y, ahead, aside = (parameters.get(f"CA_ROTOR{at}_{what}", 0.0) for what in ("PX", "PY", "AX", "AY"))
        # Axes ahead, to starboard and down: the torque about the last turns the heading up.
        push = 1.0 if parameters.get(f"CA_ROTOR{at}_CT", 1.0) >= 0.0 else -1.0
        arm = push * (x * aside - y * ahead)
        way = 0 if abs(arm) < 1e-3 else (1 if arm > 0.0 else -1)
        why = f"CA_ROTOR{at}_PX, _PY, _AX and _AY"
        outputs[f"actuator_motors.control[{at}]"] = AutopilotOutput(
            label=str(at + 1), direction=way, arm=abs(arm), reason=why
        )
    # An aircraft's motors push down, and turn it by their own drag.
    return outputs if any(output.direction for output in outputs.values()) else {}
