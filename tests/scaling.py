"""Campaigns of CSV logs in other units: another unit of time, of torque, and of the commands."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

# Column of a log: power of the time scale. Other columns are commands or have no unit of time.
_TIMES = {"time_s": 1}
_PLAIN = ("heading_deg", "roll_deg", "pitch_deg", "supply_V")


@dataclass(frozen=True, kw_only=True)
class Scaling:
    """Factors on all times, on all torques and on all commands."""

    time: float = 1.0
    torque: float = 1.0
    command: float = 1.0

    @property
    def inertia(self) -> float:
        """Factor on inertia: torque times the square of time, because headings keep their size."""
        return self.torque * self.time**2

    def factor(self, unit: str) -> float:
        """Factor on a parameter with this ``unit``."""
        unit = unit.replace("kg m^2", "N m s^2").replace("command unit", "command").replace("1/h", "1/s")
        above, _, below = unit.partition("/")
        factor = 1.0
        for part, sign in ((above, 1), (below, -1)):
            for name, power in re.findall(r"(N m|command|s)(?![a-z])(?:\^(\d))?", part):
                base = {"N m": self.torque, "command": self.command, "s": self.time}[name]
                factor *= base ** (sign * int(power or 1))
            # A rate in the unit, as N m s/rad: the time stands in the unit itself.
        return factor


def write_scaled(source: Path, folder: Path, scaling: Scaling) -> Path:
    """The CSV logs of the campaign ``source`` with other units, in a new ``folder``."""
    folder.mkdir(parents=True)
    text = (source / "rovid.toml").read_text(encoding="utf-8")

    def scaled_mass(match: re.Match[str]) -> str:
        return f"{match[1]}{float(match[2]) * scaling.inertia!r}"

    text = re.sub(r"(?m)^((?:mass|rigid_body_inertia) *= *)([\d.]+)", scaled_mass, text)
    (folder / "rovid.toml").write_text(text, encoding="utf-8")
    for path in sorted(source.glob("*.csv")):
        table = pd.read_csv(path)
        if path.name == "thrust_curve.csv":
            table = table.assign(
                command=table["command"] * scaling.command, thrust_N=table["thrust_N"] * scaling.torque
            )
        else:
            for name in table.columns:
                if name in _TIMES:
                    table[name] = table[name] * scaling.time
                elif name not in _PLAIN:
                    table[name] = table[name] * scaling.command
        table.to_csv(folder / path.name, index=False)
    return folder
