"""A synthetic trial day in surge, heave or pitch: a campaign folder of CSV logs, with something hidden or nothing.

Run ``python -m tools.axis_day OUT --axis surge --vehicle work --hide thruster_lag:0.4 --seed 3``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np

from tools.axis_programme import axis_campaign, commanded
from tools.axis_truth import AXIS_EFFECTS, AXIS_VEHICLES, METERS, Meter, Vehicle
from tools.cases import hide
from tools.hidden import Hidden
from tools.logs import command_column, write_table
from tools.programme import Run
from tools.simulate import MICRO, Held, Motion, simulate
from tools.trial_day import COMMAND_UNITS, driven, regular_instants, write_curves
from tools.truth import Axis, FloatArray, Truth

# Axis -> what rovid.toml calls a thruster's arm, and what it says of it.
_ARMS: Mapping[Axis, tuple[str, str]] = {
    "surge": ("surge", "share of the thrust along x; positive pushes ahead"),
    "heave": ("heave", "share of the thrust along z; positive pushes down"),
    "pitch": ("pitch_arm", "m; torque = pitch_arm * thrust; positive turns the bow up"),
}


def write_axis_day(
    folder: Path,
    vehicle: Vehicle,
    axis: Axis,
    hidden: Iterable[Hidden | str] = (),
    *,
    seed: int,
    variant: str | None = None,
    campaign: Sequence[Run] | None = None,
) -> Truth:
    """Write rovid.toml, thrust_curve.csv and one CSV log a run into ``folder``; return the truth behind them.

    Parameters
    ----------
    folder
        Made if it is not there.
    vehicle, axis
        One of `AXIS_VEHICLES`.
    hidden
        Effects in addition to the plain model, as `Hidden` or as the text for `hide`.
    seed
        Sets the disturbance and the noise; same seed, same files.
    variant
        Of the measurement, one of `METERS`; None: the axis's first.
    campaign
        Runs in shares of the middle thrust; None: the default runs of the axis.
    """
    truth = with_hidden(AXIS_VEHICLES[vehicle, axis], hidden)
    meter = meter_of(axis, variant)
    folder.mkdir(parents=True, exist_ok=True)
    names = write_curves(folder, truth)
    (folder / "rovid.toml").write_text(_configuration(truth, meter, names), encoding="utf-8", newline="\n")
    for index, run in enumerate(axis_campaign(truth) if campaign is None else campaign):
        rng = np.random.default_rng([seed, index])
        commands, motion = course(run, truth, meter, rng)
        columns = {
            "time_s": (motion.instant / MICRO, "%.2f"),
            meter.column: (measured(motion, meter, rng), f"%.{meter.decimals}f"),
            **{
                command_column(name, truth.command_unit): (held.at(motion.instant), "%.4f")
                for name, held in commands.items()
            },
        }
        write_table(columns, folder / f"{run.name}.csv")
    return truth


def meter_of(axis: Axis, variant: str | None = None) -> Meter:
    """What measures ``axis``; its first variant where None is named."""
    meters = METERS[axis]
    name = next(iter(meters)) if variant is None else variant
    if name not in meters:
        msg = f"{axis} has no variant {name}, but {', '.join(meters)}"
        raise ValueError(msg)
    return meters[name]


def with_hidden(truth: Truth, hidden: Iterable[Hidden | str]) -> Truth:
    """``truth`` with all of ``hidden``, which must be what can act on its axis."""
    found = tuple(hide(truth, one) if isinstance(one, str) else one for one in hidden)
    for one in found:
        if one.effect not in AXIS_EFFECTS[truth.axis]:
            msg = f"{one.effect} cannot be hidden in {truth.axis}"
            raise ValueError(msg)
    return replace(truth, hidden=(*truth.hidden, *found))


def course(run: Run, truth: Truth, meter: Meter, rng: np.random.Generator) -> tuple[dict[str, Held], Motion]:
    """Commands of each thruster through ``run`` of shares, and the motion at each sample of ``meter``.

    ``heading`` and ``rate`` of the motion are the place in m and velocity in m/s along the axis, rad and rad/s in
    pitch.
    """
    commands = {
        thruster.name: driven(commanded(run, thruster, truth), thruster, truth.instruments, meter.rate)
        for thruster in truth.thrusters
    }
    return commands, simulate(truth, tuple(commands.values()), regular_instants(run.duration, meter.rate), rng)


def measured(motion: Motion, meter: Meter, rng: np.random.Generator) -> FloatArray:
    """(n,) readings of ``meter`` in its unit, with noise, as they are rounded; adding zero turns -0 into 0."""
    true = motion.rate if meter.of_velocity else motion.heading
    noisy = true * meter.scale + rng.normal(0.0, meter.noise, len(true))
    return np.asarray(np.round(noisy, meter.decimals) + 0.0)


def _configuration(truth: Truth, meter: Meter, curves: Mapping[str, str]) -> str:
    key, says = _ARMS[truth.axis]
    thrusters = "".join(
        f"""
[[thrusters]]
name = "{thruster.name}"
{key} = {thruster.arm}    # {says}
curve = "{curves[thruster.name]}"    # command in {COMMAND_UNITS[truth.command_unit]}, thrust in N
command = {{ csv = "{command_column(thruster.name, truth.command_unit)}" }}
"""
        for thruster in truth.thrusters
    )
    return f"""\
[vehicle]
name = "{truth.name}"
mass = {truth.mass}     # kg
length = {truth.length}      # m
width = {truth.width}       # m
height = {truth.height}      # m
{thrusters}
[signals]
time = {{ csv = "time_s" }}
{meter.signal} = {{ csv = "{meter.column}", unit = "{meter.unit}" }}
"""


def main() -> None:
    """Write a trial day from the command line."""
    parser = argparse.ArgumentParser(description="Write a synthetic trial day in surge, heave or pitch.")
    parser.add_argument("out", type=Path, help="folder to write; made if it is not there")
    parser.add_argument("--axis", choices=tuple(METERS), default="surge")
    parser.add_argument("--vehicle", choices=get_args(Vehicle), default="work")
    parser.add_argument(
        "--hide",
        action="append",
        default=[],
        metavar="EFFECT[/FORM][@THRUSTER]:SIZE",
        help="what acts besides the plain model, by the names of tools/hidden.py; may be given again",
    )
    parser.add_argument("--variant", help="of the measurement; surge: velocity (as by default) or position")
    parser.add_argument("--seed", type=int, default=1, help="of disturbance and noise")
    arguments = parser.parse_args()
    try:
        write_axis_day(
            arguments.out,
            arguments.vehicle,
            arguments.axis,
            arguments.hide,
            seed=arguments.seed,
            variant=arguments.variant,
        )
    except ValueError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
