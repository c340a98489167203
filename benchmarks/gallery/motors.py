"""Logs of other fields: a race car, a motor behind a speed controller, and a motor on a bench."""

from __future__ import annotations

import re

from benchmarks.gallery import pictures
from benchmarks.gallery.base import EXTENDED, PLAIN, SAMPLES, Picture, RealSet, Step
from benchmarks.gallery.judge import Cause, Claim, Document, Reader, Reading, number, parameter, ratio, refuses

_NO_INERTIA = "There is no inertia and no drag to find behind a controller"


def _loop(word: str) -> Reader:
    """Reads the gain ("is") or the lag ("lag of") of an inner loop from the advice of `check`."""

    def read(document: Document) -> Reading | None:
        text = next((one["text"] for one in document["advice"] if one["kind"] == "inner_loop"), "")
        found = re.search(rf"{word} (-?[\d.]+) ± ([\d.]+)", text)
        return (float(found[1]), float(found[2])) if found else None

    return read


def _steps(key: str, *, loop: bool, init: bool = True) -> tuple[Step, ...]:
    fits = (
        *([Step(name="init", words=f"init {key}")] if init else []),
        Step(name="check", words=f"check {key}"),
        Step(name="fit", words=f"fit {key} -p {PLAIN}"),
        Step(name="diagnose", words=f"diagnose {key} -p {EXTENDED}"),
    )
    if loop:
        return fits
    return (*fits, Step(name="plain", words=f"simulate -p {PLAIN} --mcap plain", needs=PLAIN))


def _texts(folder: str, *others: str) -> dict[str, str]:
    return {name: (SAMPLES / folder / name).read_text(encoding="utf-8") for name in ("rovid.toml", *others)}


CAR = RealSet(
    key="f110_car",
    title="F1/10: a remotely driven race car",
    about="A race car at one tenth of its size, with steered front wheels and a speed controller: about 50 s of "
    "heading, steering angle and ordered speed, one file for each sensor, the time in two columns. The steering sets a "
    "yaw rate, near speed times tan(angle) over the wheelbase of 0.33 m, and no torque. The speed follows its order "
    "late.",
    source="DataSets/DS5 of [FrictionMaps](https://github.com/AhmadAmine998/FrictionMaps) at 6a1b907d; MIT licence, "
    "see `LICENSE`. The first 1000 rows of each file come with rovid as `sample_logs/f110_car`.",
    logs="f110_car/*Data.csv",
    texts=_texts("f110_car"),
    steps=_steps("f110_car", loop=True, init=False),
    claims=(
        Claim(
            known="The yaw rate is near speed times tan(angle) over the wheelbase: 0.7 to 1.1 times, since tyres slip",
            step="check",
            judge=number(_loop("is"), 0.7, 1.1),
        ),
        Claim(
            known="The yaw rate follows the steering late, by more than a row (0.05 s) and less than half a second",
            step="check",
            judge=number(_loop("lag of"), 0.05, 0.5, "s"),
        ),
        Claim(known=_NO_INERTIA, step="fit", judge=refuses),
        Claim(known="The log does not determine any cause", step="diagnose", judge=refuses),
    ),
    pictures=(),
    ours="The right result is the lag, and a refusal that says why there is no inertia. The range of the ratio is our "
    "estimate. Over the two whole drives of the source, which do not come with rovid, the ratio is 0.63 ± 0.04 "
    "(R² 0.79): the ordered speed is not the real one, and a ratio far from 1 says so. `rovid init` recognises "
    "the steering, its sense and the speed, but estimates the wheelbase from the same logs: the file here holds the "
    "known wheelbase, so that the ratio is a test.",
)
LOOP = RealSet(
    key="robotino_motors",
    title="Robotino: a geared motor behind a speed controller",
    about="Three geared DC motors of a mobile robot, two runs of 70 s: set speed, position, speed and current of each, "
    "under a speed controller with and without an integral part. Semicolons, three header rows (names, units, short "
    "names) and a trailing semicolon in each row, as the logger writes them. The first motor is used here.",
    source="datasets/dc_motor_model_identification of "
    "[research-wheel-slippage](https://github.com/BrOleg5/research-wheel-slippage) at b4303b4c; Apache-2.0, see "
    "`LICENSE`. The files come with rovid as `sample_logs/robotino_motors`.",
    logs="robotino_motors/*.csv",
    steps=_steps("robotino_motors", loop=True),
    claims=(
        Claim(
            known="A speed controller keeps the set speed: the speed settles near it, 0.9 to 1.1 times",
            step="check",
            judge=number(_loop("is"), 0.9, 1.1),
        ),
        Claim(
            known="The speed follows late, by more than a row (0.03 s) and less than half a second",
            step="check",
            judge=number(_loop("lag of"), 0.03, 0.5, "s"),
        ),
        Claim(known=_NO_INERTIA, step="fit", judge=refuses),
        Claim(known="The logs do not determine any cause", step="diagnose", judge=refuses),
    ),
    pictures=(),
    ours="The owner lists inertia and friction of the motor. The set speed alone cannot give them: a controller stands "
    "between it and the torque.",
)
MOTOR = RealSet(
    key="bldc_bench",
    title="A brushless motor on a bench",
    about="Duty cycle, position and speed of a brushless motor, 6 s at 1.4 kHz: a pseudo-random duty, then steps. The "
    "torque for each unit of duty is not known, so inertia and drag share an unknown scale; times do not.",
    source="dataset.mat, as CSV, of [brushless-DC-electric-motor-identification]"
    "(https://github.com/CiganOliviu/brushless-DC-electric-motor-identification) at 4f2797a8; MIT licence, see "
    "`LICENSE`. The file comes with rovid as `sample_logs/bldc_bench`.",
    logs="bldc_bench/run.csv",
    steps=_steps("bldc_bench", loop=False),
    claims=(
        Claim(
            known="The time constant, inertia over linear drag, is 0.038 s by the owner's step response, which has a "
            "dead time of 0.027 s, and near 0.10 s by a first-order fit of the whole run with a dead time of 0.009 s",
            step="fit",
            judge=number(
                ratio(parameter("parameters", "inertia"), parameter("parameters", "linear_drag")), 0.038, 0.10, "s"
            ),
        ),
    ),
    causes=(
        Cause(
            effects=("command_delay", "thruster_lag", "slew_limit"),
            acts=True,
            why="The owner's step response has a dead time of 0.027 s.",
        ),
        Cause(
            effects=("coulomb_resistance",), acts=True, why="A motor has bearings, and brushless motors have cogging."
        ),
        Cause(
            effects=("tank_seiche", "wave_torque", "entrained_swirl", "added_mass_memory", "tether_torsion"),
            acts=False,
            why="There is no water, and no cable on the shaft.",
        ),
    ),
    pictures=(
        Picture(
            name="real_bldc.png",
            caption="Speed of the motor, and the free-running simulation over the whole log.",
            draw=lambda room, _: pictures.free_runs(room, "run"),
        ),
    ),
    ours="The two values of the owner differ by a factor of two: the plain model is not the motor's. Caution is right.",
)
