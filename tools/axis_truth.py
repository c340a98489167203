"""Simulated vehicles in surge, heave and pitch: true values, sensors and effects that can be hidden.

Body axes x forward, y starboard, z down; three equations, to which hidden effects are added (tools/hidden.py):

    surge    m*udot + DQ*|u|*u + DL*u = T + d
    heave    m*wdot + DQ*|w|*w + DL*w = T + B + d                       B weight less buoyancy, downwards
    pitch    I*qdot + DQ*|q|*q + DL*q + K*sin(theta - theta0) = T + d      thetadot = q, positive bow up

T is the sum of arm*thrust(command), with `Thruster.arm` a share of the thrust in surge and heave and m in pitch. In
`Dynamics`, B is ``net_force``, K is ``restoring`` and theta0 is ``level``. Each vehicle has one degree
of freedom. The other five are held fixed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from tools.cases import Case, all_cases
from tools.truth import Attitude, Axis, BenchCurve, Disturbance, Dynamics, Instruments, Thruster, Truth

Vehicle = Literal["work", "small"]

_STILL = Attitude(roll=0.0, pitch=0.0, wander=0.0)


@dataclass(frozen=True, kw_only=True)
class Meter:
    """Sensor of the motion.

    Attributes
    ----------
    signal
        As rovid.toml names it.
    column
        Of the CSV log.
    unit
        Of the column: m/s, m or deg.
    rate
        Hz; commands are given and logged on the same clock.
    noise
        Standard deviation, white, in ``unit``.
    decimals
        That are logged.
    scale
        ``unit`` in an SI unit.
    """

    signal: str
    column: str
    unit: str
    rate: float
    noise: float
    decimals: int
    scale: float = 1.0

    @property
    def of_velocity(self) -> bool:
        """Whether it measures the velocity, not the place or the angle."""
        return self.unit == "m/s"


# Axis -> variant -> meter; the first variant is the one that is meant where none is named.
METERS: Mapping[Axis, Mapping[str, Meter]] = {
    "surge": {
        "velocity": Meter(
            signal="surge_velocity", column="surge_velocity_m_s", unit="m/s", rate=5.0, noise=0.004, decimals=3
        ),
        "position": Meter(
            signal="surge_position", column="surge_position_m", unit="m", rate=10.0, noise=0.002, decimals=4
        ),
    },
    "heave": {"depth": Meter(signal="depth", column="depth_m", unit="m", rate=10.0, noise=0.002, decimals=3)},
    "pitch": {
        "pitch": Meter(
            signal="pitch", column="pitch_deg", unit="deg", rate=20.0, noise=0.01, decimals=3, scale=180.0 / math.pi
        )
    },
}


# A vehicle of 2.6 t, with added masses and drags of a box 2.6 x 2.0 x 1.6 m in round numbers; each thruster gives
# 2.0 kN ahead and 1.5 kN astern at 5 V.
_WORK_CURVE = BenchCurve(forward=9.4, reverse=7.0)
WORK_SURGE = Truth(
    name="work-class ROV in surge (synthetic)",
    axis="surge",
    mass=2600.0,
    length=2.6,
    width=2.0,
    height=1.6,
    # Both thrusters at 600 N: 1.20 m/s. 0.97 m/s in the middle, time constant 2.6 s there.
    dynamics=Dynamics(inertia=4100.0, quadratic_drag=750.0, linear_drag=100.0),
    thrusters=(
        Thruster(name="port", arm=1.0, curve=_WORK_CURVE),
        Thruster(name="starboard", arm=1.0, curve=_WORK_CURVE),
    ),
    disturbance=Disturbance(standard_deviation=16.0),
    attitude=_STILL,
    middle=2.38,
    start=0.0,
)
WORK_HEAVE = Truth(
    name="work-class ROV in heave (synthetic)",
    axis="heave",
    mass=2600.0,
    length=2.6,
    width=2.0,
    height=1.6,
    # 0.49 m/s in the middle, time constant 2.4 s there; it rises with 0.13 m/s by itself.
    dynamics=Dynamics(inertia=5600.0, quadratic_drag=2200.0, linear_drag=150.0, net_force=-60.0),
    thrusters=(Thruster(name="fore", arm=1.0, curve=_WORK_CURVE), Thruster(name="aft", arm=1.0, curve=_WORK_CURVE)),
    disturbance=Disturbance(standard_deviation=12.0),
    attitude=_STILL,
    middle=2.10,
    start=60.0,
)
WORK_PITCH = Truth(
    name="work-class ROV in pitch (synthetic)",
    axis="pitch",
    mass=2600.0,
    length=2.6,
    width=2.0,
    height=1.6,
    # K is 0.1 m of metacentric height: natural period 7.4 s. 10 deg in the middle.
    dynamics=Dynamics(
        inertia=3500.0, quadratic_drag=3000.0, linear_drag=250.0, restoring=2550.0, level=math.radians(-1.2)
    ),
    thrusters=(Thruster(name="fore", arm=0.85, curve=_WORK_CURVE), Thruster(name="aft", arm=0.75, curve=_WORK_CURVE)),
    disturbance=Disturbance(standard_deviation=8.6),
    attitude=_STILL,
    middle=2.01,
    start=math.radians(-1.2),
)

# A BlueROV2 in round numbers (EFFECTS.md section 2), with T200 thrusters: neutral 1500 us, none within 28 us of it.
_SMALL_CURVE = BenchCurve(forward=3.76e-5, reverse=2.95e-5, dead_zone=28.0, limit=400.0, neutral=1500.0, step=2.0)
_SMALL_INSTRUMENTS = Instruments(command_span=4096.0, supply=16.0, supply_drop=0.002)
_VECTORED = 0.7071  # cos 45 deg
SMALL_SURGE = Truth(
    name="small ROV in surge (synthetic)",
    axis="surge",
    mass=11.5,
    length=0.46,
    width=0.44,
    height=0.254,
    # 0.94 m/s in the middle, time constant 0.44 s there.
    dynamics=Dynamics(inertia=17.0, quadratic_drag=18.2, linear_drag=4.0),
    thrusters=tuple(
        Thruster(name=name, arm=_VECTORED, curve=_SMALL_CURVE)
        for name in ("fore_port", "fore_starboard", "aft_port", "aft_starboard")
    ),
    disturbance=Disturbance(standard_deviation=0.4),
    attitude=_STILL,
    instruments=_SMALL_INSTRUMENTS,
    command_unit="us",
    middle=166.0,
    pace=0.4,
    start=0.0,
)
SMALL_HEAVE = Truth(
    name="small ROV in heave (synthetic)",
    axis="heave",
    mass=11.5,
    length=0.46,
    width=0.44,
    height=0.254,
    # 0.45 m/s in the middle, time constant 0.7 s there; it rises with 0.12 m/s by itself.
    dynamics=Dynamics(inertia=26.0, quadratic_drag=37.0, linear_drag=5.2, net_force=-1.2),
    thrusters=(
        Thruster(name="port", arm=1.0, curve=_SMALL_CURVE),
        Thruster(name="starboard", arm=1.0, curve=_SMALL_CURVE),
    ),
    disturbance=Disturbance(standard_deviation=0.2),
    attitude=_STILL,
    instruments=_SMALL_INSTRUMENTS,
    command_unit="us",
    middle=144.0,
    pace=0.4,
    start=30.0,
)
SMALL_PITCH = Truth(
    name="small ROV in pitch (synthetic)",
    axis="pitch",
    mass=11.5,
    length=0.46,
    width=0.44,
    height=0.254,
    # K is 0.02 m of metacentric height: natural period 2.6 s. 10 deg in the middle. The thrusters push against each
    # other: the fore one up and the aft one down for bow up.
    dynamics=Dynamics(inertia=0.40, quadratic_drag=0.8, linear_drag=0.10, restoring=2.3, level=math.radians(0.8)),
    thrusters=(
        Thruster(name="fore", arm=0.12, curve=_SMALL_CURVE),
        Thruster(name="aft", arm=-0.12, curve=_SMALL_CURVE),
    ),
    disturbance=Disturbance(standard_deviation=0.008),
    attitude=_STILL,
    instruments=_SMALL_INSTRUMENTS,
    command_unit="us",
    middle=95.0,
    pace=0.4,
    start=math.radians(0.8),
)

AXIS_VEHICLES: Mapping[tuple[Vehicle, Axis], Truth] = {
    ("work", "surge"): WORK_SURGE,
    ("work", "heave"): WORK_HEAVE,
    ("work", "pitch"): WORK_PITCH,
    ("small", "surge"): SMALL_SURGE,
    ("small", "heave"): SMALL_HEAVE,
    ("small", "pitch"): SMALL_PITCH,
}

_ACTUATORS = frozenset(
    {
        "thruster_deadband",
        "thrust_asymmetry",
        "thruster_imbalance",
        "thrust_curve_shape",
        "thruster_lag",
        "command_delay",
        "slew_limit",
        "command_hysteresis",
    }
)
# What is left out acts on a heading alone, needs a signal that is not logged, or is the model's own constant already:
# a constant force in heave is B, and a constant torque in pitch is another theta0.
AXIS_EFFECTS: Mapping[Axis, frozenset[str]] = {
    "surge": _ACTUATORS
    | {
        "drag_asymmetry",
        "drag_curvature",
        "coulomb_resistance",
        "bias_torque",
        "advance_speed_loss",
        "added_mass_memory",
    },
    "heave": _ACTUATORS | {"drag_asymmetry", "drag_curvature", "advance_speed_loss", "added_mass_memory"},
    "pitch": _ACTUATORS | {"added_mass_memory", "restoring_curve"},
}


def axis_cases(truth: Truth) -> list[Case]:
    """Nothing, then every effect that can be hidden on the truth's axis, in every form at both sizes."""
    allowed = AXIS_EFFECTS[truth.axis]
    return [case for case in all_cases(truth) if all(one.effect in allowed for one in case.hidden)]
