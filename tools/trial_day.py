"""A synthetic trial day: every run of the programme through the simulator, logged as real instruments would.

Run ``python -m tools.trial_day OUT --seed 1``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from tools.logs import WRITERS, Recording
from tools.programme import CAMPAIGN, Format, Run
from tools.simulate import MICRO, Held, Motion, simulate
from tools.truth import ROSUB, BenchCurve, FloatArray, Instruments, IntArray, Truth

Formats = Literal["mixed", "csv"]

_DAY = 1_767_600_000 * MICRO  # us since the epoch: 5 January 2026, 08:00 UTC
_BETWEEN_RUNS = 600 * MICRO  # us from the start of a run to that of the next
_COMMAND_DECIMALS = 4
_CURVE_STEP = 0.01  # V; linear interpolation of the square law is then off by 0.0024 N at most
_FIRST_HEADING = 30_000  # us after the log begins, in MCAP: commands are known by then
_JITTER = 1_500.0  # us, standard deviation of the heading's instants in MCAP


def write_trial_day(
    folder: Path,
    *,
    seed: int,
    formats: Formats = "mixed",
    truth: Truth = ROSUB,
    campaign: Sequence[Run] = CAMPAIGN,
) -> Truth:
    """Write rovid.toml, thrust_curve.csv and one log a run into ``folder``; return the truth behind them.

    Parameters
    ----------
    seed
        Sets the disturbance, the noise and the heading each run starts at; same seed, same files.
    formats
        "mixed": each run in its own format, with its own command clock; "csv": all of them as CSV at 20 Hz.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_configuration(folder, truth)
    for index, run in enumerate(campaign):
        kind: Format = run.format if formats == "mixed" else "csv"
        suffix, write = WRITERS[kind]
        write(record(run, truth, kind, seed, index), folder / f"{run.name}{suffix}")
    return truth


def record(run: Run, truth: Truth, kind: Format, seed: int, index: int) -> Recording:
    """Simulate ``run``, the day's number ``index``, and measure it."""
    rng = np.random.default_rng([seed, index])
    instruments = truth.instruments
    sample = _sample_instants(run.duration, instruments.rate, kind, rng)
    commands = {
        thruster.name: _held(run, thruster.name, kind, instruments, number)
        for number, thruster in enumerate(truth.thrusters)
    }
    motion = simulate(truth, tuple(commands.values()), sample, rng)
    return measure(motion, commands, instruments, start=_DAY + index * _BETWEEN_RUNS, rng=rng)


def measure(
    motion: Motion,
    commands: dict[str, Held],
    instruments: Instruments,
    *,
    start: int,
    rng: np.random.Generator,
) -> Recording:
    """Add noise to ``motion`` and round it; ``start`` is in us since the epoch."""
    heading, roll, pitch = (
        _rounded(np.degrees(angle) + rng.normal(0.0, instruments.angle_noise, len(angle)), instruments)
        for angle in (motion.heading, motion.roll, motion.pitch)
    )
    load = np.sum([np.abs(held.at(motion.instant)) for held in commands.values()], axis=0)
    noise = rng.normal(0.0, instruments.supply_noise, len(load))
    return Recording(
        start=start,
        instant=motion.instant,
        # Rounded again: the remainder of a rounded number is not quite one.
        heading=_rounded(heading % 360.0, instruments) % 360.0,
        roll=roll,
        pitch=pitch,
        supply=np.round(instruments.supply - instruments.supply_drop * load + noise, 2),
        commands=commands,
    )


def _rounded(angle: FloatArray, instruments: Instruments) -> FloatArray:
    """``angle`` in deg as it is logged; adding zero turns -0 into 0."""
    rounded: FloatArray = np.round(angle, instruments.angle_decimals) + 0.0
    return rounded


def _ticks(duration: float, rate: float) -> FloatArray:
    """Instants in us of a clock at ``rate`` in Hz, through ``duration`` in s."""
    ticks: FloatArray = np.arange(round(duration * rate) + 1, dtype=np.float64) * (MICRO / rate)
    return ticks


def _whole(instant: FloatArray) -> IntArray:
    """Whole microseconds."""
    whole: IntArray = np.rint(instant).astype(np.int64)
    return whole


def _sample_instants(duration: float, rate: float, kind: Format, rng: np.random.Generator) -> IntArray:
    """Instants in us at which the angles are measured: regular in CSV, with jitter in MCAP."""
    ticks = _ticks(duration, rate)
    if kind == "csv":
        return _whole(ticks)
    jitter = rng.normal(0.0, _JITTER, len(ticks)).clip(-4.0 * _JITTER, 4.0 * _JITTER)
    return _whole(ticks + jitter + _FIRST_HEADING)


def _held(run: Run, thruster: str, kind: Format, instruments: Instruments, number: int) -> Held:
    """Command of one thruster as it is given and logged; in CSV on the clock of the heading."""
    if kind == "csv":
        return _driven(run, thruster, instruments, instruments.rate)
    held = _driven(run, thruster, instruments, run.command_rate or instruments.rate)
    changed = np.diff(held.value, prepend=np.inf) != 0.0
    kept = slice(None) if run.command_rate else changed
    # Each thruster is published a little after the one before it.
    return Held(instant=held.instant[kept] + 3_700 + 900 * number, value=held.value[kept])


def _driven(run: Run, thruster: str, instruments: Instruments, rate: float) -> Held:
    """Command of one thruster, given at ``rate`` in Hz from time 0 on."""
    instant = _whole(_ticks(run.duration, rate))
    volts = run.command(instant / MICRO) * (run.only in {None, thruster})
    return Held(instant=instant, value=quantised(volts, instruments))


def quantised(volts: FloatArray, instruments: Instruments) -> FloatArray:
    """``volts`` as the converter puts them out, to the decimals that are logged."""
    step = instruments.command_span / 2**instruments.command_bits
    value: FloatArray = np.round(np.rint(volts / step) * step, _COMMAND_DECIMALS) + 0.0
    return value


def write_configuration(folder: Path, truth: Truth) -> None:
    """Write rovid.toml and the thrust curves it names: one curve where all thrusters are alike."""
    curves = {thruster.curve for thruster in truth.thrusters}
    names = {
        thruster.name: "thrust_curve.csv" if len(curves) == 1 else f"thrust_curve_{thruster.name}.csv"
        for thruster in truth.thrusters
    }
    for thruster in truth.thrusters:
        _write_curve(folder / names[thruster.name], thruster.curve)
    (folder / "rovid.toml").write_text(_configuration(truth, names), encoding="utf-8", newline="\n")


def _write_curve(path: Path, curve: BenchCurve) -> None:
    """Table command,thrust_N of ``curve``; the edges of the dead zone are among the points."""
    edges = (-curve.dead_zone, curve.dead_zone)
    command = np.arange(-curve.limit, curve.limit + _CURVE_STEP / 2.0, _CURVE_STEP)
    command = np.unique(np.round([*command, *edges], _COMMAND_DECIMALS)) + 0.0
    rows = zip(command.tolist(), curve.thrust(command).tolist(), strict=True)
    lines = ["command,thrust_N", *(f"{volts:.4g},{thrust:.4f}" for volts, thrust in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _configuration(truth: Truth, curves: dict[str, str]) -> str:
    thrusters = "".join(
        f"""
[[thrusters]]
name = "{thruster.name}"
yaw_arm = {thruster.yaw_arm}            # m; torque = yaw_arm * thrust; positive turns the heading up
curve = "{curves[thruster.name]}"    # command in V, thrust in N
command = {{ csv = "{thruster.name}_V", mcap = "/thrusters/{thruster.name}.data" }}
"""
        for thruster in truth.thrusters
    )
    return f"""\
[vehicle]
name = "{truth.name}"
mass = {truth.mass}     # kg
length = {truth.length}      # m
width = {truth.width}       # m
{thrusters}
[signals]
time = {{ csv = "time_s" }}
heading = {{ csv = "heading_deg", mcap = "/phins/heading.data", unit = "deg" }}
roll = {{ csv = "roll_deg", mcap = "/phins/roll.data", unit = "deg" }}
pitch = {{ csv = "pitch_deg", mcap = "/phins/pitch.data", unit = "deg" }}
supply_voltage = {{ csv = "supply_V", mcap = "/power/supply.data" }}
"""


def main() -> None:
    """Write a trial day from the command line."""
    parser = argparse.ArgumentParser(description="Write a synthetic trial day.")
    parser.add_argument("out", type=Path, help="folder to write; made if it is not there")
    parser.add_argument("--seed", type=int, default=1, help="of disturbance, noise and start headings")
    parser.add_argument("--formats", choices=("mixed", "csv"), default="mixed")
    arguments = parser.parse_args()
    write_trial_day(arguments.out, seed=arguments.seed, formats=arguments.formats)


if __name__ == "__main__":
    main()
