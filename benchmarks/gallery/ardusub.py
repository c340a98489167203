"""Two files of ArduSub vehicles that were made for other purposes: what a user finds who drops them into a folder."""

from __future__ import annotations

from benchmarks.gallery import pictures
from benchmarks.gallery.base import EXTENDED, PLAIN, Picture, RealSet, Step
from benchmarks.gallery.judge import UNDECIDED, WRONG, Claim, commands_within, guesses, refuses

_TELEMETRY = tuple(f"SERVO_OUTPUT_RAW.servo{k}_raw" for k in range(1, 9))
_TELEMETRY_VOLTAGE = ("SYS_STATUS.voltage_battery", "BATTERY_STATUS.voltages", "BATTERY_STATUS.voltages[0]")
_FLASH = tuple(f"RCOU.C{k}" for k in range(1, 7))
_SOURCE = (
    "The folder `testing` of [ardusub_log_tools](https://github.com/clydemcqueen/ardusub_log_tools) at 2b7c8b1; MIT "
    "licence, Copyright (c) 2023-2025 Clyde McQueen. "
)
_VOLTAGE = {
    WRONG: "What is taken for the voltage is another number about the battery.",
    UNDECIDED: "To leave it out is no harm.",
}


def _first_look(key: str, log: str) -> tuple[Step, ...]:
    return (
        Step(name="init", words=f"init {key}"),
        Step(name="check", words=f"check {key}"),
        Step(name="fit-drag", words=f"fit-drag {key} -p drag.toml"),
        Step(name="fit", words=f"fit {key} -p {PLAIN}"),
        Step(name="diagnose", words=f"diagnose {key} -p {EXTENDED}"),
        Step(name="convert", words=f"convert {key}/{log} -o log.csv"),
    )


TLOG = RealSet(
    key="ardusub_tlog",
    title="ArduSub telemetry: small.tlog",
    about="263 s of telemetry of a BlueROV2 Heavy: attitude at 20 Hz, the outputs to the thrusters at 2 Hz. It turns "
    "by 107 deg in all, nearly all of it while its thrusters rest; they push for some seconds near the end, in bursts "
    "that two readings hold. There is no physics of yaw in it: the question is what rovid says.",
    source=_SOURCE + "The messages that rovid reads come with it as `sample_logs/ardusub_small/small.tlog`.",
    logs="ardusub_small/small.tlog",
    steps=_first_look("ardusub_tlog", "small.tlog"),
    claims=(
        Claim(
            known="Outputs 1 to 8 are thrusters, 12 and 13 are lights: the log's own parameters SERVO1_FUNCTION to "
            "SERVO8_FUNCTION are 33 to 40 (motors 1 to 8), SERVO12_FUNCTION and SERVO13_FUNCTION are 60 and 59 (an "
            "input of the pilot handed through)",
            step="init",
            judge=commands_within(_TELEMETRY),
            remarks={WRONG: "A light is taken for a thruster. Who reads `rovid.toml` before going on can see it."},
        ),
        Claim(
            known="The battery's voltage is in SYS_STATUS.voltage_battery and BATTERY_STATUS.voltages: 16.2 V",
            step="init",
            judge=guesses("supply_voltage", _TELEMETRY_VOLTAGE),
            remarks=_VOLTAGE,
        ),
        Claim(
            known="No drag can be read from it: wherever the thrusters hold a command, they rest",
            step="fit-drag",
            judge=refuses,
            remarks={
                WRONG: "The one hold that it uses is a light's; the thrusters rest, the vehicle drifts at 0.4 deg/s."
            },
        ),
        Claim(known="No inertia can be read from it", step="fit", judge=refuses),
        Claim(known="No cause can be named from it", step="diagnose", judge=refuses),
    ),
    pictures=(
        Picture(
            name="real_ardusub_tlog.png",
            caption="Heading and the outputs to the four thrusters that can turn the vehicle.",
            draw=lambda room, _: pictures.outputs(
                room / "log.csv",
                {f"motor {k}": f"command_motor_{k}" for k in range(1, 5)},
                {},
            ),
        ),
    ),
    ours="The right answer to this file is a refusal in plain words, and a `rovid.toml` that somebody can go on with.",
)

FLASH = RealSet(
    key="ardusub_bin",
    title="ArduSub DataFlash: small.BIN",
    about="24 s of the log of a BlueROV2 with six thrusters, at rest: the heading stays within 0.2 deg, and the pulses "
    "within 8 us of neutral, where a T200 does not push.",
    source=_SOURCE + "It comes with rovid as `sample_logs/ardusub_small/small.BIN`.",
    logs="ardusub_small/small.BIN",
    steps=_first_look("ardusub_bin", "small.BIN"),
    claims=(
        Claim(
            known="Outputs 1 to 6 are thrusters: the log's own parameters SERVO1_FUNCTION to SERVO6_FUNCTION are 33 "
            "to 38 (motors 1 to 6)",
            step="init",
            judge=commands_within(_FLASH),
        ),
        Claim(
            known="The battery's voltage is in BAT.Volt: 17.4 V",
            step="init",
            judge=guesses("supply_voltage", ("BAT.Volt",)),
            remarks=_VOLTAGE,
        ),
        Claim(known="No drag can be read from it", step="fit-drag", judge=refuses),
        Claim(known="No inertia can be read from it", step="fit", judge=refuses),
        Claim(known="No cause can be named from it", step="diagnose", judge=refuses),
    ),
    pictures=(
        Picture(
            name="real_ardusub_bin.png",
            caption="Heading and the outputs to four thrusters.",
            draw=lambda room, _: pictures.outputs(
                room / "log.csv", {f"motor {k}": f"command_motor_{k}" for k in range(1, 5)}, {}
            ),
        ),
    ),
    ours="The right answer to this file is a refusal in plain words.",
)
