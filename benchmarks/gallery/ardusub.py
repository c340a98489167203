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
_VOLTAGE = {WRONG: "Another battery quantity counts as the voltage.", UNDECIDED: "The omission does no harm."}


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
    about="263 s of telemetry of a BlueROV2 Heavy: attitude at 20 Hz, the outputs to the thrusters at 2 Hz. The "
    "vehicle turns by 107 deg in total, almost entirely while its thrusters rest. The thrusters run for some "
    "seconds near the end, in bursts of two readings. The file contains no usable yaw dynamics. It tests rovid's "
    "messages.",
    source=_SOURCE + "The messages that rovid reads come with rovid as `sample_logs/ardusub_small/small.tlog`.",
    logs="ardusub_small/small.tlog",
    steps=_first_look("ardusub_tlog", "small.tlog"),
    claims=(
        Claim(
            known="Outputs 1 to 8 are thrusters, 12 and 13 are lights: in the log the parameters SERVO1_FUNCTION "
            "to SERVO8_FUNCTION are 33 to 40 (motors 1 to 8), SERVO12_FUNCTION and SERVO13_FUNCTION are 60 and "
            "59 (a pass-through of a pilot input)",
            step="init",
            judge=commands_within(_TELEMETRY),
            remarks={WRONG: "A light counts as a thruster. Users who check `rovid.toml` can see the error."},
        ),
        Claim(
            known="The battery's voltage is in SYS_STATUS.voltage_battery and BATTERY_STATUS.voltages: 16.2 V",
            step="init",
            judge=guesses("supply_voltage", _TELEMETRY_VOLTAGE),
            remarks=_VOLTAGE,
        ),
        Claim(
            known="The log does not determine drag: every held command is zero thrust",
            step="fit-drag",
            judge=refuses,
            remarks={
                WRONG: "The only hold in use is a command of a light; the thrusters rest, and the vehicle drifts "
                "at 0.4 deg/s."
            },
        ),
        Claim(known="The log does not determine inertia", step="fit", judge=refuses),
        Claim(known="The log does not determine any cause", step="diagnose", judge=refuses),
    ),
    pictures=(
        Picture(
            name="real_ardusub_tlog.png",
            caption="Heading and the outputs to the four thrusters that can turn the vehicle.",
            draw=lambda room, _: pictures.outputs(
                room / "log.csv", {f"motor {k}": f"command_motor_{k}" for k in range(1, 5)}, {}
            ),
        ),
    ),
    ours="The right result for this file is a clear error message, and a `rovid.toml` that a user can complete.",
)

FLASH = RealSet(
    key="ardusub_bin",
    title="ArduSub DataFlash: small.BIN",
    about="24 s of the log of a BlueROV2 with six thrusters, at rest. The heading stays within 0.2 deg, and the "
    "pulses within 8 us of neutral, where a T200 has no thrust.",
    source=_SOURCE + "The file comes with rovid as `sample_logs/ardusub_small/small.BIN`.",
    logs="ardusub_small/small.BIN",
    steps=_first_look("ardusub_bin", "small.BIN"),
    claims=(
        Claim(
            known="Outputs 1 to 6 are thrusters: in the log the parameters SERVO1_FUNCTION to SERVO6_FUNCTION are 33 "
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
        Claim(known="The log does not determine drag", step="fit-drag", judge=refuses),
        Claim(known="The log does not determine inertia", step="fit", judge=refuses),
        Claim(known="The log does not determine any cause", step="diagnose", judge=refuses),
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
    ours="The right result for this file is a clear error message.",
)
