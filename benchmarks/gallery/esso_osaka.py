"""Zigzags and turning circles of a ship's model; its logs are not handed on, and no picture of them is drawn."""

from __future__ import annotations

from benchmarks.gallery import pictures
from benchmarks.gallery.base import Picture, RealSet, model_steps
from benchmarks.gallery.judge import WRONG, Cause, Claim, names, physical

_TOML = """[vehicle]
name = "Esso Osaka model"

[signals]
time = { csv = "time_s" }
heading = { csv = "heading_deg", unit = "deg" }
torque = { csv = "rudder_effort" }     # n|n| sin(rudder): a torque of unknown scale
surge_velocity = { csv = "surge_m_s" }
sway_velocity = { csv = "sway_m_s" }
wind = { csv = "wind_m_s" }
"""
_ONE_WAY = ("bias_torque", "thrust_asymmetry", "drag_asymmetry")

ESSO = RealSet(
    key="esso_osaka",
    title="Esso Osaka: zigzags and turning circles of a ship's model",
    about="A 3 m model of the tanker Esso Osaka, free running on a pond of Osaka University, 2020: nine zigzags and "
    "six turning circles at 10 Hz. A rudder and a propeller turn it in place of thrusters, so that rovid is given a "
    "torque: `rudder_effort`, n·|n|·sin(rudder), in proportion to it by a scale that nobody knows; inertia and drag "
    "have that scale too. A ship that turns drifts, loses half of its way and feels the wind. The plain model knows "
    "of none of that.",
    source="[FRT-DS-ESSO](https://github.com/NAOE-5thLab/FRT-DS-ESSO) at e694dfd6, Osaka University (Wakita et al., "
    "doi 10.1007/s00773-021-00867-1; Miyauchi et al., doi 10.1007/s00773-022-00889-3). Creative Commons BY-NC-SA: "
    "the logs do not come with rovid, nor is any reading of them drawn here. The columns are theirs, converted and "
    "renamed.",
    logs="esso_osaka/*.csv",
    texts={"rovid.toml": _TOML},
    steps=model_steps("esso_osaka"),
    claims=(
        Claim(
            known="An inertia is positive and no drag negative, however badly a model fits: the plain one",
            step="fit",
            judge=physical("parameters"),
        ),
        Claim(
            known="The same of the model with what was found",
            step="diagnose",
            judge=physical("extended", "parameters"),
        ),
        Claim(
            known="It turns faster one way: read off the circles, 0.0433 rad/s at 35 deg of rudder and 0.0495 rad/s "
            "at -35, 0.034 and 0.040 rad/s at 20 deg. A constant torque, a rudder that works less one way and "
            "unequal drag all do that, and these runs hardly tell them apart: one of the three has to be named",
            step="diagnose",
            judge=names(*_ONE_WAY),
            remarks={WRONG: "The difference is 14 to 18 %, and plain in the logs."},
        ),
    ),
    causes=(
        Cause(effects=_ONE_WAY, acts=True, why="Steady turns are 14 to 18 % faster one way."),
        Cause(
            effects=("speed_dependent_damping", "advance_speed_loss", "sideslip_moment"),
            acts=True,
            why="Damping with speed, a rudder that works by the flow along the ship, and the moment of drift are in "
            "every manoeuvring model of a ship.",
        ),
        Cause(
            effects=("thruster_lag", "command_delay", "slew_limit", "added_mass_memory"),
            acts=True,
            why="The log has the rudder's order, which leaps by 60 deg within 0.1 s; no steering gear does.",
        ),
        Cause(
            effects=("heading_dependent_torque", "wave_torque", "tank_seiche"),
            acts=None,
            why="There was some wind, of 0.5 to 2 m/s. How much it and the pond's water turned the model nobody "
            "measured.",
        ),
        Cause(
            effects=("coulomb_resistance",),
            acts=False,
            why="Nothing rubs on a hull that floats free: it stands in for a drag, a rudder and a drift of another "
            "shape.",
        ),
        Cause(effects=("tether_torsion",), acts=False, why="The model ran free: there was no cable."),
    ),
    pictures=(
        Picture(
            name="real_esso_osaka.png",
            caption="How much of each run's yaw rate the freely running simulation explains: 1 is all of it.",
            draw=lambda _, answers: pictures.by_run(answers),
        ),
    ),
    ours="A ship is not what rovid's plain model is made for. What can be asked of it here is that it stays sane, "
    "says how much the plain model misses, and names nothing that is not there.",
)
