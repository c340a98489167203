"""A BlueROV2's dive, with the bench curve of its thrusters and without."""

from __future__ import annotations

from benchmarks.gallery import pictures
from benchmarks.gallery.base import SAMPLES, Picture, RealSet, model_steps
from benchmarks.gallery.judge import RIGHT, WRONG, Cause, Claim, names, number, parameter, ratio, size_of

_LOG = "00000029_filtered"
_TOML = (SAMPLES / "bluerov2_dataflash" / "rovid.toml").read_text(encoding="utf-8")
_CURVE = "t200_16V_curve.csv"
_SOURCE = (
    "`logs/00000029_filtered.BIN` of "
    "[guided_above_terrain](https://github.com/clydemcqueen/guided_above_terrain) at 3276cc2e; MIT licence, Copyright "
    "(c) 2026 Clyde McQueen. Most of it comes with rovid as `sample_logs/bluerov2_dataflash`."
)
_CAUSES = (
    Cause(
        effects=("thruster_lag",),
        acts=True,
        why="The rotors of a T200 take some time to follow: published models of it have a lag of 0.15 s, or poles "
        "worth 0.03 s.",
    ),
    Cause(
        effects=("advance_speed_loss",),
        acts=True,
        why="Turning, a T200 on this vehicle has an advance ratio of 0.19 at any rate, which takes nearly a fifth "
        "of its thrust. Most of that passes for drag.",
    ),
    Cause(
        effects=("added_mass_memory",),
        acts=None,
        why="In published models the whole added inertia is 0.6 to 0.75 of the hull's own. A memory of more than that "
        "stands in for something else.",
    ),
    Cause(
        effects=("coulomb_resistance",),
        acts=None,
        why="In open water nothing rubs but a tether. Four thrusters that idle about their dead zone, and push less "
        "there than on the bench, look the same. Nothing independent tells.",
    ),
    Cause(effects=("tank_seiche",), acts=False, why="The vehicle was in open water: there is no tank to ring."),
)

DIVE = RealSet(
    key="bluerov2",
    title="BlueROV2: a dive, with the thrusters' bench curve",
    about="A BlueROV2 Heavy off Pier 59 in Seattle, 7 January 2026: 200 s of the autopilot's own log at 10 Hz, the "
    "autopilot on throughout. 0 to 69 s steady heading, 70 to 90 s ahead, 92 to 115 s and 150 to 182 s yaw steps of "
    "the pilot, up to 60 deg/s. The thrust curve is the one that Blue Robotics publishes for the T200 at 16 V, "
    "about what the battery had.",
    source=_SOURCE,
    logs=f"bluerov2_pier59/{_LOG}.BIN",
    texts={
        "rovid.toml": _TOML.replace("../bluerov2_pier59/", ""),
        _CURVE: (SAMPLES / "bluerov2_pier59" / _CURVE).read_text(encoding="utf-8"),
    },
    steps=model_steps("bluerov2"),
    claims=(
        Claim(
            known="The plain model's inertia is 2.5 kg m², if the lever arm is 0.167 m: by another program, which fits "
            "the freely simulated yaw rate behind a 1 Hz low pass",
            step="fit",
            judge=number(parameter("parameters", "inertia"), 2.4, 2.6, "kg m²"),
        ),
        Claim(
            known="Its linear drag is 5.3 N m s/rad, by the same",
            step="fit",
            judge=number(parameter("parameters", "linear_drag"), 5.2, 5.4, "N m s/rad"),
        ),
        Claim(
            known="Inertia over quadratic drag is 0.18 to 0.40 rad: 0.59/1.5 (von Benzon et al., J. Mar. Sci. Eng. 10, "
            "1898, 2022) and 0.28/1.55 (used in simulators, after Wu 2018). The ratio depends neither on the lever arm "
            "nor on the scale of the thrust, which nobody measured here. Held against the model with what was found",
            step="diagnose",
            judge=number(
                ratio(
                    parameter("extended", "parameters", "inertia"),
                    parameter("extended", "parameters", "quadratic_drag"),
                ),
                0.18,
                0.40,
                "rad",
            ),
            remarks={
                RIGHT: "The plain model has no quadratic drag at all, where published ones have little else.",
                WRONG: "What was found does not bring the model to what others measured.",
            },
        ),
    ),
    causes=(
        *_CAUSES,
        Cause(
            effects=("thruster_deadband",),
            acts=None,
            why="The bench curve has its dead zone, 1472 to 1528 us. Whether these thrusters have a wider one is not "
            "known.",
        ),
    ),
    pictures=(
        Picture(
            name="real_bluerov2.png",
            caption="The dive's yaw rate, and what each model makes of its commands, simulated freely over the whole "
            "log.",
            draw=lambda room, _: pictures.free_runs(room, _LOG),
        ),
    ),
    ours="One dive of 200 s under an autopilot can hardly tell a friction from a dead zone, nor a memory of the "
    "water from a lag of the rotors. What can be checked is the plain model, and whether what is found brings the "
    "ratio of its numbers to what others measured in a tank. A cause that is established here claims more than "
    "anybody can check.",
)

STRAIGHT = RealSet(
    key="bluerov2_straight",
    title="BlueROV2: the same dive, the bench curve kept from rovid",
    about="The same log. For the thrust curve rovid is given a straight line, as by somebody who has no bench curve: "
    "thrust in proportion to the pulse. Now something is hidden of which the bench knows the truth.",
    source=_SOURCE,
    logs=f"bluerov2_pier59/{_LOG}.BIN",
    texts={
        "rovid.toml": _TOML.replace(f"../bluerov2_pier59/{_CURVE}", "straight.csv"),
        "straight.csv": "command,thrust_N\n1100,-40\n1500,0\n1900,40\n",
    },
    steps=model_steps("bluerov2_straight"),
    claims=(
        Claim(
            known="The thrusters have a dead zone: on the bench they do not push between 1472 and 1528 us",
            step="diagnose",
            judge=names("thruster_deadband", by_name=True),
        ),
        Claim(
            known="It is 25 to 45 us wide on either side: 28 us on the bench, and just beyond it the curve begins "
            "flat, so that a straight one fits with a wider zone",
            step="diagnose",
            judge=number(size_of("thruster_deadband", "deadband"), 25.0, 45.0, "us"),
        ),
    ),
    causes=(
        Cause(effects=("thruster_deadband",), acts=True, why="1472 to 1528 us on the bench at 16 V."),
        Cause(
            effects=("thrust_curve_shape",),
            acts=True,
            why="On the bench thrust grows faster than the pulse: 9 N at 100 us beyond the dead zone, 51 N at 372 us.",
        ),
        Cause(
            effects=("thrust_asymmetry",),
            acts=True,
            why="In reverse the T200 gives 0.75 to 0.85 of its thrust, on the bench. In yaw two of the thrusters "
            "always push back, so that most of it passes for a scale of all thrust.",
        ),
        *_CAUSES,
    ),
    pictures=(
        Picture(
            name="real_bluerov2_straight.png",
            caption="The same yaw rate with a straight thrust curve: the plain model turns by pulses that move "
            "nothing.",
            draw=lambda room, _: pictures.free_runs(room, _LOG),
        ),
    ),
    ours="This stands nearest to a blind test on real water: a cause that surely acts, that shows in the free run, and "
    "whose size a bench has measured.",
)
