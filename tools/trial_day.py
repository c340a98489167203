"""A synthetic trial day: every run of the programme through the simulator, logged as real instruments would.

Run ``python -m tools.trial_day OUT --seed 1``, with ``--hide thruster_lag:0.6`` for what acts besides the plain model.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from tools.cases import hide
from tools.channels import CHANNELS, SUPPLY, column, needed
from tools.hidden import acting
from tools.logs import WRITERS, Recording, command_column
from tools.programme import CAMPAIGN, Format, Run, campaign_for
from tools.simulate import MICRO, Held, Motion, simulate
from tools.truth import ROSUB, BenchCurve, FloatArray, Instruments, IntArray, Thruster, Truth, Unit

Formats = Literal["mixed", "csv"]

_DAY = 1_767_600_000 * MICRO  # us since the epoch: 5 January 2026, 08:00 UTC
_BETWEEN_RUNS = 600 * MICRO  # us from the start of a run to that of the next
_COMMAND_DECIMALS = 4
COMMAND_UNITS: Mapping[Unit, str] = {"V": "V", "us": "us", "1": "-1..1"}
_FIRST_HEADING = 30_000  # us after the log begins, in MCAP: commands are known by then
_JITTER = 1_500.0  # us, standard deviation of the heading's instants in MCAP


def write_trial_day(
    folder: Path, *, seed: int, formats: Formats = "mixed", truth: Truth = ROSUB, campaign: Sequence[Run] | None = None
) -> Truth:
    """Write rovid.toml, thrust_curve.csv and one log a run into ``folder``; return the truth behind them.

    Parameters
    ----------
    seed
        Sets the disturbance, the noise and the heading each run starts at; same seed, same files.
    formats
        "mixed": each run in its own format, with its own command clock; "csv": all runs as CSV at 20 Hz.
    truth
        Vehicle with its hidden effects.
    campaign
        Runs; None: the default runs for ``truth``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_configuration(folder, truth)
    for index, run in enumerate(campaign_for(truth) if campaign is None else campaign):
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
        thruster.name: _held(run, thruster, kind, instruments, number)
        for number, thruster in enumerate(truth.thrusters)
    }
    motion = simulate(truth, tuple(commands.values()), sample, rng)
    return measure(motion, commands, truth, start=_DAY + index * _BETWEEN_RUNS, rng=rng)


def measure(
    motion: Motion, commands: dict[str, Held], truth: Truth, *, start: int, rng: np.random.Generator
) -> Recording:
    """Add the instruments' errors and noise to ``motion`` and round it; ``start`` is in us since the epoch."""
    instruments = truth.instruments
    (extra,) = rng.spawn(1)
    heading, roll, pitch = (
        _rounded(np.degrees(angle) + rng.normal(0.0, instruments.angle_noise, len(angle)), instruments)
        for angle in (deviated(motion.heading, truth), motion.roll, motion.pitch)
    )
    load = np.sum([np.abs(held.at(motion.instant) - held.neutral) for held in commands.values()], axis=0)
    noise = rng.normal(0.0, instruments.supply_noise, len(load))
    return Recording(
        start=start,
        instant=motion.instant,
        # Rounded again: the remainder of a rounded number is not quite one.
        heading=_rounded(heading % 360.0, instruments) % 360.0,
        roll=roll,
        pitch=pitch,
        supply=np.round(instruments.supply - instruments.supply_drop * load + motion.supply + noise, 2),
        commands=commands,
        unit=truth.command_unit,
        channels={name: _logged(name, value, extra) for name, value in motion.channels.items()},
    )


def deviated(heading: FloatArray, truth: Truth) -> FloatArray:
    """``heading`` in rad as an instrument with the hidden deviation shows it."""
    hidden = acting(truth.hidden).get("heading_deviation")
    if hidden is None:
        return heading
    amplitude, phase = hidden.parameters["amplitude"], hidden.parameters["phase"]
    once, twice = np.sin(heading + phase), np.sin(2.0 * heading + phase)
    shapes = {"one_cycle": once, "two_cycles": twice, "mixed": once + 0.5 * np.sin(2.0 * heading - phase)}
    return np.asarray(heading + amplitude * shapes[hidden.form])


def _logged(name: str, value: FloatArray, rng: np.random.Generator) -> FloatArray:
    """An extra signal with its noise, as it is rounded."""
    channel = CHANNELS[name]
    noisy = value + rng.normal(0.0, channel.noise, len(value))
    return np.asarray(np.round(noisy, channel.decimals) + 0.0)


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
    if kind == "csv":
        return regular_instants(duration, rate)
    ticks = _ticks(duration, rate)
    jitter = rng.normal(0.0, _JITTER, len(ticks)).clip(-4.0 * _JITTER, 4.0 * _JITTER)
    return _whole(ticks + jitter + _FIRST_HEADING)


def regular_instants(duration: float, rate: float) -> IntArray:
    """(n,) instants in us of a clock at ``rate`` in Hz, from 0 through ``duration`` in s."""
    return _whole(_ticks(duration, rate))


def _held(run: Run, thruster: Thruster, kind: Format, instruments: Instruments, number: int) -> Held:
    """Command of one thruster as it is given and logged; in CSV on the clock of the heading."""
    if kind == "csv":
        return driven(run, thruster, instruments, instruments.rate)
    held = driven(run, thruster, instruments, run.command_rate or instruments.rate)
    changed = np.diff(held.value, prepend=np.inf) != 0.0
    kept = slice(None) if run.command_rate else changed
    # Each thruster is published a little after the one before it.
    return Held(instant=held.instant[kept] + 3_700 + 900 * number, value=held.value[kept], neutral=held.neutral)


def driven(run: Run, thruster: Thruster, instruments: Instruments, rate: float) -> Held:
    """Command of one thruster, given at ``rate`` in Hz from time 0 on."""
    instant = regular_instants(run.duration, rate)
    neutral = thruster.curve.neutral
    offset = run.command(instant / MICRO) * (run.only in {None, thruster.name})
    return Held(instant=instant, value=quantised(neutral + offset, instruments), neutral=neutral)


def quantised(volts: FloatArray, instruments: Instruments) -> FloatArray:
    """``volts`` as the converter puts them out, to the decimals that are logged."""
    step = instruments.command_span / 2**instruments.command_bits
    value: FloatArray = np.round(np.rint(volts / step) * step, _COMMAND_DECIMALS) + 0.0
    return value


def write_configuration(folder: Path, truth: Truth) -> None:
    """Write rovid.toml and the thrust curves it names."""
    text = _configuration(truth, write_curves(folder, truth))
    (folder / "rovid.toml").write_text(text, encoding="utf-8", newline="\n")


def write_curves(folder: Path, truth: Truth) -> dict[str, str]:
    """Write the thrust curves, one where all thrusters are alike; return thruster -> name of its file."""
    curves = {thruster.curve for thruster in truth.thrusters}
    names = {
        thruster.name: "thrust_curve.csv" if len(curves) == 1 else f"thrust_curve_{thruster.name}.csv"
        for thruster in truth.thrusters
    }
    for thruster in truth.thrusters:
        _write_curve(folder / names[thruster.name], thruster.curve)
    return names


def _write_curve(path: Path, curve: BenchCurve) -> None:
    """Table command,thrust_N of ``curve``; the edges of the dead zone are among the points."""
    edges = (-curve.dead_zone, curve.dead_zone)
    offset = np.arange(-curve.limit, curve.limit + curve.step / 2.0, curve.step)
    command = np.unique(np.round(curve.neutral + np.array([*offset, *edges]), _COMMAND_DECIMALS)) + 0.0
    rows = zip(command.tolist(), curve.thrust(command).tolist(), strict=True)
    lines = ["command,thrust_N", *(f"{volts:.4g},{thrust:.4f}" for volts, thrust in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _configuration(truth: Truth, curves: dict[str, str]) -> str:
    thrusters = "".join(
        f"""
[[thrusters]]
name = "{thruster.name}"
yaw_arm = {thruster.arm}            # m; torque = yaw_arm * thrust; positive turns the heading up
curve = "{curves[thruster.name]}"    # command in {COMMAND_UNITS[truth.command_unit]}, thrust in N
command = {{ csv = "{command_column(thruster.name, truth.command_unit)}", mcap = "/thrusters/{thruster.name}.data" }}
"""
        for thruster in truth.thrusters
    )
    extra = "".join(
        f'{name} = {{ csv = "{column(name)}", mcap = "/extra/{name}.data" }}\n'
        for name in needed(truth)
        if name != SUPPLY
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
{extra}"""


def main() -> None:
    """Write a trial day from the command line."""
    parser = argparse.ArgumentParser(description="Write a synthetic trial day.")
    parser.add_argument("out", type=Path, help="folder to write; made if it is not there")
    parser.add_argument("--seed", type=int, default=1, help="of disturbance, noise and start headings")
    parser.add_argument("--formats", choices=("mixed", "csv"), default="mixed")
    parser.add_argument("--rate", type=float, default=ROSUB.instruments.rate, help="Hz, of heading, roll and pitch")
    parser.add_argument("--runs", nargs="+", choices=[run.name for run in CAMPAIGN], help="all if not given")
    parser.add_argument(
        "--hide",
        action="append",
        default=[],
        metavar="EFFECT[/FORM][@THRUSTER]:SIZE",
        help="what acts besides the plain model, by the names of tools/hidden.py; may be given again",
    )
    arguments = parser.parse_args()
    try:
        hidden = tuple(hide(ROSUB, text) for text in arguments.hide)
    except ValueError as error:
        parser.error(str(error))
    instruments = replace(ROSUB.instruments, rate=arguments.rate)
    write_trial_day(
        arguments.out,
        seed=arguments.seed,
        formats=arguments.formats,
        truth=replace(ROSUB, instruments=instruments, hidden=hidden),
        campaign=[run for run in CAMPAIGN if arguments.runs is None or run.name in arguments.runs],
    )


if __name__ == "__main__":
    main()
