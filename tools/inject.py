"""Hide an effect in a real log, file by file, if no new simulation of the vehicle is necessary.

The motion stays as measured. The logged commands, the thrust curve or the logged heading change. Effects that act
through the motion cannot be hidden in this way and are refused.

Run ``python -m tools.inject sample_logs/bluerov2_pier59 OUT command_delay delay=0.2``.
"""

from __future__ import annotations

import argparse
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tools.hidden import FORMS, Hidden
from tools.truth import FloatArray

_CONFIGURATION = "rovid.toml"
_LONGEST_GAP = 1.0  # s; across more than this no command is interpolated


@dataclass(frozen=True, kw_only=True)
class Source:
    """A campaign folder with one CSV log, and the command at which its thrusters stand still."""

    folder: Path
    log: str = "dive.csv"
    neutral: float = 1500.0

    @property
    def configuration(self) -> dict[str, Any]:
        """What rovid.toml says."""
        return tomllib.loads((self.folder / _CONFIGURATION).read_text(encoding="utf-8"))


def inject(source: Source, out: Path, hidden: Sequence[Hidden]) -> Path:
    """Write ``source`` with all of ``hidden`` to the folder ``out``: configuration, curves and log. Returns ``out``."""
    for one in hidden:
        if (one.effect, one.form) not in INJECTABLE:
            msg = f"{one.effect}/{one.form} acts through the motion: it cannot be hidden in a log that is there"
            raise ValueError(msg)
    out.mkdir(parents=True, exist_ok=True)
    acts = [one for one in hidden if one.acts]
    table = pd.read_csv(source.folder / source.log)
    for one in acts:
        if one.effect in _LOG:
            table = _LOG[one.effect](table, source, one)
    # A log to which nothing is done stays as it was, byte for byte.
    if any(one.effect in _LOG for one in acts):
        table.to_csv(out / source.log, index=False, float_format="%.9g", lineterminator="\n")
    else:
        (out / source.log).write_bytes((source.folder / source.log).read_bytes())
    _write_curves(source, out, acts)
    return out


def linear_curve(source: Source, out: Path) -> Path:
    """Write ``source`` to ``out`` with thrust taken as proportional to the command, equal at the curve's ends."""
    inject(source, out, ())
    for thruster in source.configuration["thrusters"]:
        curve = pd.read_csv(source.folder / thruster["curve"])
        offset = curve["command"] - source.neutral
        slope = float(np.ptp(curve["thrust_N"]) / np.ptp(curve["command"]))
        _write_curve(
            out / thruster["curve"], curve["command"].to_numpy(np.float64), (slope * offset).to_numpy(np.float64)
        )
    return out


def _write_curves(source: Source, out: Path, hidden: Sequence[Hidden]) -> None:
    """Copy configuration and curves, altered where something is hidden in them."""
    text = (source.folder / _CONFIGURATION).read_text(encoding="utf-8")
    for thruster in source.configuration["thrusters"]:
        name = thruster["curve"]
        mine = [one for one in hidden if one.effect in _CURVE and one.thruster in {None, thruster["name"]}]
        if any(one.thruster for one in mine):
            name = f"{Path(name).stem}_{thruster['name']}.csv"
            text = _renamed(text, thruster["name"], thruster["curve"], name)
        if not mine:
            (out / name).write_bytes((source.folder / thruster["curve"]).read_bytes())
            continue
        curve = pd.read_csv(source.folder / thruster["curve"])
        command, thrust = (curve[column].to_numpy(np.float64) for column in ("command", "thrust_N"))
        # What acts last on the way from command to thrust is undone first.
        for one in reversed(mine):
            thrust = _CURVE[one.effect](command - source.neutral, thrust, one)
        _write_curve(out / name, command, thrust)
    (out / _CONFIGURATION).write_text(text, encoding="utf-8", newline="\n")


def _renamed(text: str, thruster: str, old: str, new: str) -> str:
    """The configuration with another curve for one thruster."""
    pattern = rf'(name = "{re.escape(thruster)}".*?curve = "){re.escape(old)}"'
    renamed, count = re.subn(pattern, rf'\g<1>{new}"', text, count=1, flags=re.DOTALL)
    if count != 1:
        msg = f"{_CONFIGURATION}: no curve of {thruster}"
        raise ValueError(msg)
    return renamed


def _write_curve(path: Path, command: FloatArray, thrust: FloatArray) -> None:
    curve = pd.DataFrame({"command": command, "thrust_N": thrust + 0.0})
    curve.to_csv(path, index=False, float_format="%.8g", lineterminator="\n")


def _earlier_commands(table: pd.DataFrame, source: Source, hidden: Hidden) -> pd.DataFrame:
    """Log each command as it was ``delay`` s later, linearly between rows; rows whose command is unknown go.

    The vehicle then answers what is logged that much later than it answered the command in truth.
    """
    configuration = source.configuration
    time = table[configuration["signals"]["time"]["csv"]].to_numpy(np.float64)
    wanted = time + hidden.parameters["delay"]
    out = table.copy()
    for thruster in configuration["thrusters"]:
        column = thruster["command"]["csv"]
        out[column] = np.interp(wanted, time, table[column].to_numpy(np.float64))
    following = np.minimum(np.searchsorted(time, wanted), len(time) - 1)
    gap = time[following] - time[np.maximum(following - 1, 0)]
    known: pd.DataFrame = out.loc[(wanted <= time[-1]) & (gap <= _LONGEST_GAP)]
    return known


def _deviating_heading(table: pd.DataFrame, source: Source, hidden: Hidden) -> pd.DataFrame:
    """Add the deviation to the logged heading, which must be in deg; a gyro's rate stays as it is."""
    column = source.configuration["signals"]["heading"]["csv"]
    heading = np.radians(table[column].to_numpy(np.float64))
    cycles = 2.0 if hidden.form == "two_cycles" else 1.0
    deviation = hidden.parameters["amplitude"] * np.sin(cycles * heading + hidden.parameters["phase"])
    return table.assign(**{column: np.round(np.degrees(heading + deviation), 6) % 360.0})


def _without_dead_zone(offset: FloatArray, thrust: FloatArray, hidden: Hidden) -> FloatArray:
    """Curve without the dead band: curve'(v) = curve(|v| + deadband). Shifted by ``deadband`` the curve is true."""
    moved = offset + np.sign(offset) * hidden.parameters["deadband"]
    return np.asarray(np.interp(moved, offset, thrust))


def _even(offset: FloatArray, thrust: FloatArray, hidden: Hidden) -> FloatArray:
    """Curve whose reverse branch is that of a thruster without the loss."""
    return np.where(offset < 0.0, thrust / hidden.parameters["reverse_gain"], thrust)


def _sound(offset: FloatArray, thrust: FloatArray, hidden: Hidden) -> FloatArray:
    """Curve of the thruster as if it were not the weak one."""
    del offset
    return thrust / hidden.parameters["gain"]


def _unshaped(offset: FloatArray, thrust: FloatArray, hidden: Hidden) -> FloatArray:
    """Curve that the exponent turns into the true one."""
    del offset
    reference = hidden.parameters["thrust"]
    share = np.abs(thrust) / reference
    return np.asarray(np.sign(thrust) * reference * share ** (1.0 / hidden.parameters["exponent"]))


_LOG: Mapping[str, Callable[[pd.DataFrame, Source, Hidden], pd.DataFrame]] = {
    "command_delay": _earlier_commands,
    "heading_deviation": _deviating_heading,
}
_CURVE: Mapping[str, Callable[[FloatArray, FloatArray, Hidden], FloatArray]] = {
    "thruster_deadband": _without_dead_zone,
    "thrust_asymmetry": _even,
    "thruster_imbalance": _sound,
    "thrust_curve_shape": _unshaped,
}
INJECTABLE: tuple[tuple[str, str], ...] = (
    ("command_delay", "constant"),
    ("heading_deviation", "one_cycle"),
    ("heading_deviation", "two_cycles"),
    ("thruster_deadband", "shift"),
    ("thrust_asymmetry", "gain"),
    ("thruster_imbalance", "gain"),
    ("thrust_curve_shape", "power"),
)


def main() -> None:
    """Hide one effect from the command line."""
    parser = argparse.ArgumentParser(description="Hide an effect in a real log.")
    parser.add_argument("source", type=Path, help="campaign folder")
    parser.add_argument("out", type=Path, help="folder to write; made if it is not there")
    parser.add_argument("effect", choices=sorted({effect for effect, _ in INJECTABLE}))
    parser.add_argument("parameters", nargs="+", help="name=value, in SI or command units")
    parser.add_argument("--form", help="of the effect; the first of its forms if none is given")
    parser.add_argument("--thruster", help="the one that thruster_imbalance makes weak")
    parser.add_argument("--log", default="dive.csv")
    parser.add_argument("--neutral", type=float, default=1500.0, help="command at which thrusters stand still")
    arguments = parser.parse_args()
    values = dict(text.split("=", 1) for text in arguments.parameters)
    hidden = Hidden(
        effect=arguments.effect,
        form=arguments.form or next(iter(FORMS[arguments.effect])),
        parameters={name: float(value) for name, value in values.items()},
        thruster=arguments.thruster,
    )
    source = Source(folder=arguments.source, log=arguments.log, neutral=arguments.neutral)
    inject(source, arguments.out, [hidden])


if __name__ == "__main__":
    main()
