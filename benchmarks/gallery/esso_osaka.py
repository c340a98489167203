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
    title="Esso Osaka: zigzags and turning circles of a model ship",
    about="A 3 m model of the tanker Esso Osaka, free running on a pond of Osaka University, 2020: nine zigzags "
    "and six turning circles at 10 Hz. A rudder and a propeller turn the model. rovid therefore uses a logged "
    "torque: `rudder_effort`, n·|n|·sin(rudder), proportional to the true torque with an unknown scale. Inertia "
    "and drag have the same unknown scale. A turning ship drifts, loses half of its speed and is affected by "
    "wind. The plain model contains none of these effects.",
    source="[FRT-DS-ESSO](https://github.com/NAOE-5thLab/FRT-DS-ESSO) at e694dfd6, Osaka University (Wakita et al., "
    "doi 10.1007/s00773-021-00867-1; Miyauchi et al., doi 10.1007/s00773-022-00889-3). Creative Commons BY-NC-SA: "
    "the logs do not come with rovid, and none of their readings are plotted here. The columns are the "
    "originals, converted and renamed.",
    logs="esso_osaka/*.csv",
    texts={"rovid.toml": _TOML},
    steps=model_steps("esso_osaka"),
    claims=(
        Claim(
            known="Inertia is positive and no drag is negative, however poor the fit: plain model",
            step="fit",
            judge=physical("parameters"),
        ),
        Claim(known="The same for the extended model", step="diagnose", judge=physical("extended", "parameters")),
        Claim(
            known="The model turns faster in one direction: the circles show 0.0433 rad/s at 35 deg of rudder "
            "and 0.0495 rad/s at -35, 0.034 and 0.040 rad/s at 20 deg. A constant torque, a less effective "
            "rudder on one side and asymmetric drag all have this result, and these runs hardly separate them: "
            "one of the three has to be named",
            step="diagnose",
            judge=names(*_ONE_WAY),
            remarks={WRONG: "The difference is 14 to 18 %, clearly visible in the logs."},
        ),
    ),
    causes=(
        Cause(effects=_ONE_WAY, acts=True, why="Steady turns are 14 to 18 % faster in one direction."),
        Cause(
            effects=("speed_dependent_damping", "advance_speed_loss", "sideslip_moment"),
            acts=True,
            why="Damping with speed, a rudder force that depends on the flow along the ship, and the moment of "
            "drift are part of every manoeuvring model of a ship.",
        ),
        Cause(
            effects=("thruster_lag", "command_delay", "slew_limit", "added_mass_memory"),
            acts=True,
            why="The log contains the rudder order, which jumps by 60 deg within 0.1 s; no steering gear is that fast.",
        ),
        Cause(
            effects=("heading_dependent_torque", "wave_torque", "tank_seiche"),
            acts=None,
            why="There was wind of 0.5 to 2 m/s. Its torque, and the torque of the pond's water, were not measured.",
        ),
        Cause(
            effects=("coulomb_resistance",),
            acts=False,
            why="A free hull has no friction: the effect replaces a drag, a rudder force and a drift of another form.",
        ),
        Cause(effects=("tether_torsion",), acts=False, why="The model was free, without a cable."),
    ),
    pictures=(
        Picture(
            name="real_esso_osaka.png",
            caption="R² of the free-running yaw rate for each run; 1 is a perfect simulation.",
            draw=lambda _, answers: pictures.by_run(answers),
        ),
    ),
    ours="rovid's plain model is not made for ships. Reasonable requirements here are physical parameters, a "
    "correct statement of the plain model's error, and no false cause.",
)
