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
    "(c) 2026 Clyde McQueen. Most of the log comes with rovid as `sample_logs/bluerov2_dataflash`."
)
_CAUSES = (
    Cause(
        effects=("thruster_lag",),
        acts=True,
        why="The rotors of a T200 respond with a lag: published models have a lag of 0.15 s, or poles equivalent "
        "to 0.03 s.",
    ),
    Cause(
        effects=("advance_speed_loss",),
        acts=True,
        why="In a turn, a T200 on this vehicle has an advance ratio of 0.19 at any rate and loses nearly a fifth "
        "of its thrust. Most of this loss looks like drag.",
    ),
    Cause(
        effects=("added_mass_memory",),
        acts=None,
        why="In published models the total added inertia is 0.6 to 0.75 of the hull's own. A larger memory term "
        "replaces another effect.",
    ),
    Cause(
        effects=("coulomb_resistance",),
        acts=None,
        why="In open water only a tether can rub. Four thrusters that idle near their dead zone, with less "
        "thrust than on the bench, look the same. There is no independent evidence.",
    ),
    Cause(
        effects=("tank_seiche",), acts=False, why="The vehicle was in open water. There is no tank with standing waves."
    ),
)

DIVE = RealSet(
    key="bluerov2",
    title="BlueROV2: a dive, with the thrusters' bench curve",
    about="A BlueROV2 Heavy off Pier 59 in Seattle, 7 January 2026: 200 s of the autopilot's own log at 10 Hz, the "
    "autopilot on throughout. 0 to 69 s steady heading, 70 to 90 s ahead, 92 to 115 s and 150 to 182 s yaw steps of "
    "the pilot, up to 60 deg/s. The thrust curve is the published curve of Blue Robotics for the T200 at 16 V, "
    "close to the battery's voltage.",
    source=_SOURCE,
    logs=f"bluerov2_pier59/{_LOG}.BIN",
    texts={
        "rovid.toml": _TOML.replace("../bluerov2_pier59/", ""),
        _CURVE: (SAMPLES / "bluerov2_pier59" / _CURVE).read_text(encoding="utf-8"),
    },
    steps=model_steps("bluerov2"),
    claims=(
        Claim(
            known="The plain model's inertia is 2.5 kg m² for a lever arm of 0.167 m. Source: another program, "
            "which fits the free-running yaw rate behind a 1 Hz low pass",
            step="fit",
            judge=number(parameter("parameters", "inertia"), 2.4, 2.6, "kg m²"),
        ),
        Claim(
            known="The linear drag is 5.3 N m s/rad, from the same program",
            step="fit",
            judge=number(parameter("parameters", "linear_drag"), 5.2, 5.4, "N m s/rad"),
        ),
        Claim(
            known="Inertia over quadratic drag is 0.18 to 0.40 rad: 0.59/1.5 (von Benzon et al., J. Mar. Sci. Eng. 10, "
            "1898, 2022) and 0.28/1.55 (used in simulators, after Wu 2018). The ratio depends neither on the "
            "lever arm nor on the scale of the thrust, and neither was measured here. Compared with the extended "
            "model",
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
                RIGHT: "The plain model has no quadratic drag at all; published models have little else.",
                WRONG: "The diagnosed causes do not bring the model to the published values.",
            },
        ),
    ),
    causes=(
        *_CAUSES,
        Cause(
            effects=("thruster_deadband",),
            acts=None,
            why="The bench curve has a dead zone of 1472 to 1528 us. A wider dead zone of these thrusters is "
            "possible but unknown.",
        ),
    ),
    pictures=(
        Picture(
            name="real_bluerov2.png",
            caption="The yaw rate of the dive, and the free-running simulation of each model over the whole log.",
            draw=lambda room, _: pictures.free_runs(room, _LOG),
        ),
    ),
    ours="One dive of 200 s under an autopilot hardly separates friction from a dead zone, or memory of the "
    "water from a rotor lag. The plain model can be checked, and the ratio of inertia and drag of the extended "
    "model can be compared with published tank tests. Nobody can check the established causes of "
    "this dive.",
)

STRAIGHT = RealSet(
    key="bluerov2_straight",
    title="BlueROV2: the same dive, without the bench curve",
    about="The same log. Here the thrust curve is a straight line, thrust proportional to the pulse, as used "
    "without a bench curve. The true curve is known from the bench, and its dead zone is hidden from rovid.",
    source=_SOURCE,
    logs=f"bluerov2_pier59/{_LOG}.BIN",
    texts={
        "rovid.toml": _TOML.replace(f"../bluerov2_pier59/{_CURVE}", "straight.csv"),
        "straight.csv": "command,thrust_N\n1100,-40\n1500,0\n1900,40\n",
    },
    steps=model_steps("bluerov2_straight"),
    claims=(
        Claim(
            known="The thrusters have a dead zone: on the bench they have no thrust between 1472 and 1528 us",
            step="diagnose",
            judge=names("thruster_deadband", by_name=True),
        ),
        Claim(
            known="The dead zone is 25 to 45 us wide on each side: 28 us on the bench. The curve is flat just "
            "beyond it, and a straight curve therefore fits with a wider zone",
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
            why="In reverse the T200 gives 0.75 to 0.85 of its thrust on the bench. In yaw two of the thrusters "
            "always run in reverse, and most of the asymmetry looks like a scale of all thrust.",
        ),
        *_CAUSES,
    ),
    pictures=(
        Picture(
            name="real_bluerov2_straight.png",
            caption="The same yaw rate with a straight thrust curve: the plain model responds to pulses that "
            "have no effect on the vehicle.",
            draw=lambda room, _: pictures.free_runs(room, _LOG),
        ),
    ),
    ours="This set is the closest to a blind test on real data: the cause certainly acts, is visible in the "
    "free-running simulation, and its size was measured on a bench.",
)
