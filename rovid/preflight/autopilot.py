"""Thrusters in an autopilot's parameters: their outputs, and the directions in which they turn the vehicle.

ArduPilot: SERVOn_FUNCTION is the function of output n (33 to 40 and 82 to 85: motors 1 to 12; 73 and 74: throttles to
port and to starboard); FRAME_CONFIG is the layout of the motors of a submarine; MOT_n_DIRECTION and SERVOn_REVERSED
reverse them. PX4: CA_ROTORn_PX, _PY, _AX, _AY and _CT are position, thrust axis and thrust coefficient of motor n.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# FRAME_CONFIG of ArduSub -> direction in which each motor turns the bow to starboard; the other motors do not turn it.
# Source: the motor tables in ArduPilot's AP_Motors6DOF.
_PAIR, _VECTORED = {1: -1, 2: 1}, {1: 1, 2: -1, 3: -1, 4: 1}
_FRAMES = {0: _PAIR, 1: _VECTORED, 2: _VECTORED, 3: {2: 1, 7: -1}, 4: _PAIR, 5: _PAIR, 6: _PAIR}
_FRAME = "FRAME_CONFIG"
# Frames that only one type of vehicle has.
_TYPES = {1: "bluerov2", 2: "bluerov2-heavy"}
_MOTORS = {**{33 + at: 1 + at for at in range(8)}, **{82 + at: 9 + at for at in range(4)}}
_THROTTLES = {73: ("port", 1), 74: ("starboard", -1)}
_OUTPUTS = 16


@dataclass(frozen=True, kw_only=True)
class AutopilotOutput:
    """Thruster at one output of the autopilot."""

    label: str  #: Number of the motor, or its side.
    direction: int  #: Direction in which more of the command turns the heading; 0 for neither.
    reason: str  #: Parameters that define the thruster.
    arm: float = 0.0  #: m; 0 if not known.

    @property
    def name(self) -> str:
        """Name of the thruster in rovid.toml."""
        return f"motor_{self.label}" if self.label.isdigit() else self.label


def thruster_outputs(parameters: Mapping[str, float]) -> dict[str, AutopilotOutput]:
    """Source -> thruster that it commands; empty if the parameters do not say."""
    return _px4_outputs(parameters) or _ardupilot_outputs(parameters)


def vehicle_type(parameters: Mapping[str, float]) -> str:
    """Type of vehicle by the frame; empty if the parameters do not say."""
    return _TYPES.get(_integer(parameters, _FRAME, -1), "")


def _integer(parameters: Mapping[str, float], name: str, default: int) -> int:
    value = parameters.get(name, default)
    return int(value) if abs(value) < 1e6 else default


def _ardupilot_outputs(parameters: Mapping[str, float]) -> dict[str, AutopilotOutput]:
    directions = _FRAMES.get(_integer(parameters, _FRAME, -1))
    outputs = {}
    for number in range(1, _OUTPUTS + 1):
        key = f"SERVO{number}_FUNCTION"
        function = _integer(parameters, key, 0)
        if function in _THROTTLES:
            label, direction = _THROTTLES[function]
            reason = f"{key} is {function}, the throttle to {label}"
        elif function in _MOTORS and directions is not None:
            motor = _MOTORS[function]
            label, direction = str(motor), directions.get(motor, 0)
            if not parameters.get(f"MOT_{motor}_DIRECTION", 1.0) >= 0.0:
                direction = -direction
            reason = f"{key} is {function}, motor {motor}; by {_FRAME} and MOT_{motor}_DIRECTION"
        else:
            continue
        if _integer(parameters, f"SERVO{number}_REVERSED", 0):
            direction = -direction
        output = AutopilotOutput(label=label, direction=direction, reason=reason)
        # The source in a DataFlash log, and in telemetry.
        outputs[f"RCOU.C{number}" if number <= 14 else f"RCO2.C{number}"] = output
        outputs[f"SERVO_OUTPUT_RAW.servo{number}_raw"] = output
    return outputs


def _px4_outputs(parameters: Mapping[str, float]) -> dict[str, AutopilotOutput]:
    outputs = {}
    for at in range(_integer(parameters, "CA_ROTOR_COUNT", 0)):
        x, y, ahead, aside = (parameters.get(f"CA_ROTOR{at}_{what}", 0.0) for what in ("PX", "PY", "AX", "AY"))
        # Axes are forward, starboard, down: a positive torque about the last one turns the heading up.
        sign = 1.0 if parameters.get(f"CA_ROTOR{at}_CT", 1.0) >= 0.0 else -1.0
        arm = sign * (x * aside - y * ahead)
        direction = 0 if abs(arm) < 1e-3 else (1 if arm > 0.0 else -1)
        outputs[f"actuator_motors.control[{at}]"] = AutopilotOutput(
            label=str(at + 1), direction=direction, arm=abs(arm), reason=f"CA_ROTOR{at}_PX, _PY, _AX and _AY"
        )
    # The motors of a multicopter thrust along z, and turn it by their drag.
    return outputs if any(output.direction for output in outputs.values()) else {}
