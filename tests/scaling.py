"""Campaigns of CSV logs whose times, torques and commands are scaled, as those of a vehicle of another size."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

# Columns of a log that no scaling changes: angles, and a voltage.
_UNCHANGED = {"heading_deg", "roll_deg", "pitch_deg", "supply_V"}
_BASES = re.compile(r"(N m|kg m\^2|kg|N|command|s|h)(?:\^([\d.]+))?(?![a-zA-Z])")


@dataclass(frozen=True, kw_only=True)
class Scaling:
    """Factors on all times, all torques and all commands; headings keep their size."""

    time: float = 1.0
    torque: float = 1.0
    command: float = 1.0

    def factor(self, unit: str) -> float:
        """Factor on a parameter with this ``unit``."""
        inertia = self.torque * self.time**2
        # Lengths keep their size.
        sizes = {"N m": self.torque, "N": self.torque, "kg m^2": inertia, "kg": inertia, "command": self.command}
        sizes |= {"s": self.time, "h": self.time}
        factor = 1.0
        for part, sign in zip(unit.split("/"), (1, -1), strict=False):
            for name, power in _BASES.findall(part):
                factor *= sizes[name] ** (sign * float(power or 1))
        return factor


def write_scaled(source: Path, folder: Path, scaling: Scaling) -> Path:
    """The CSV logs of the campaign ``source``, scaled, in a new ``folder``."""
    folder.mkdir(parents=True)

    def scaled_mass(found: re.Match[str]) -> str:
        return f"{found[1]}{float(found[2]) * scaling.factor('kg m^2')!r}"

    config = (source / "rovid.toml").read_text(encoding="utf-8")
    config = re.sub(r"(?m)^((?:mass|rigid_body_inertia) *= *)([\d.]+)", scaled_mass, config)
    (folder / "rovid.toml").write_text(config, encoding="utf-8")
    for path in sorted(source.glob("*.csv")):
        table = pd.read_csv(path)
        for name in set(table.columns) - _UNCHANGED:
            factor = {"time_s": scaling.time, "thrust_N": scaling.torque}.get(name, scaling.command)
            table[name] = table[name] * factor
        table.to_csv(folder / path.name, index=False)
    return folder
