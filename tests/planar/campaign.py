"""A small campaign of the coupled model on disk: each sensor with its own rate, stamps and gaps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.planar.dataset import PlanarData, planar_data
from rovid.readers import read_campaign
from rovid.trial.config import load_planar_config

# Instants of each sensor: rate in Hz, and s by which the first stamp is late.
RATES = {"heading": (20.0, 0.0), "surge_velocity": (5.0, 0.013), "north": (1.0, 0.31)}
CURVE = "command,thrust_N\n-1,-40\n1,40\n"
SIGNALS = """
[signals]
time = { csv = "t" }
heading = { csv = "hdg", unit = "deg" }
yaw_rate = { csv = "gyro", unit = "deg/s" }
surge_velocity = { csv = "u" }
sway_velocity = { csv = "v", unit = "cm/s" }
north = { csv = "n" }
east = { csv = "e" }
"""
PORT_AND_STARBOARD = """
[[thrusters]]
name = "port"
surge = 1.0
yaw_arm = 0.3
curve = "curve.csv"
command = { csv = "a" }
[[thrusters]]
name = "starboard"
surge = 1.0
yaw_arm = -0.3
curve = "curve.csv"
command = { csv = "b" }
"""


@dataclass(frozen=True)
class Motion:
    """A vehicle whose surge and yaw answer two thrusters at once; sway is a tenth of surge."""

    seconds: float = 120.0
    seed: int = 0

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        step = 0.01
        time = np.arange(0.0, self.seconds + step / 2, step)
        levels = np.round(rng.uniform(-1.0, 1.0, (int(self.seconds / 4.0) + 1, 2)), 2)
        commands = levels[(time / 4.0).astype(int)]
        force = 40.0 * np.column_stack((commands.sum(axis=1), 0.3 * (commands[:, 0] - commands[:, 1])))
        u, r = np.zeros((2, len(time)))
        for k in range(len(time) - 1):
            u[k + 1] = u[k] + step * (force[k, 0] - 60.0 * u[k]) / 50.0
            r[k + 1] = r[k] + step * (force[k, 1] - 20.0 * r[k]) / 8.0
        heading = 1.0 + _integral(r, step)
        v = 0.1 * u
        north = _integral(u * np.cos(heading) - v * np.sin(heading), step)
        east = _integral(u * np.sin(heading) + v * np.cos(heading), step)
        columns = {"hdg": np.degrees(heading), "gyro": np.degrees(r), "u": u, "v": 100.0 * v, "n": north, "e": east}
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "columns", columns)
        object.__setattr__(self, "commands", {"a": commands[:, 0], "b": commands[:, 1]})

    time: FloatArray = None  # type: ignore[assignment]  # set above
    columns: dict[str, FloatArray] = None  # type: ignore[assignment]  # set above
    commands: dict[str, FloatArray] = None  # type: ignore[assignment]  # set above

    def at(self, name: str, stamps: FloatArray) -> FloatArray:
        """Values of a column at ``stamps`` in s."""
        return np.interp(stamps, self.time, self.columns[name])


def _integral(rate: FloatArray, step: float) -> FloatArray:
    return np.concatenate(([0.0], np.cumsum(0.5 * step * (rate[1:] + rate[:-1]))))


def stamps_of(sensor: str, seconds: float) -> FloatArray:
    """Stamps of a sensor in s."""
    rate, late = RATES[sensor]
    return np.arange(late, seconds, 1.0 / rate)


def write_log(path: Path, motion: Motion, *, without: tuple[float, float] = (0.0, 0.0)) -> None:
    """One table with a row for each stamp of any sensor; the DVL is silent between the seconds ``without``."""
    cells: dict[float, dict[str, str]] = {}
    groups = {"heading": ("hdg", "gyro"), "surge_velocity": ("u", "v"), "north": ("n", "e")}
    for sensor, names in groups.items():
        for stamp in np.round(stamps_of(sensor, motion.seconds), 4).tolist():
            if sensor == "surge_velocity" and without[0] <= stamp < without[1]:
                continue
            for name in names:
                cells.setdefault(stamp, {})[name] = f"{motion.at(name, np.array([stamp]))[0]:.6f}"
    columns = [*motion.columns, *motion.commands]
    rows = [",".join(["t", *columns])]
    for stamp, row in sorted(cells.items()):
        row |= {name: f"{values[int(round(stamp / 0.01, 6))]:.2f}" for name, values in motion.commands.items()}
        rows.append(",".join([f"{stamp:.4f}", *(row.get(name, "") for name in columns)]))
    path.write_text("\n".join(rows) + "\n")


def write_campaign(folder: Path, actuators: str = PORT_AND_STARBOARD, signals: str = SIGNALS, logs: int = 2) -> None:
    """Logs, curve and rovid.toml."""
    (folder / "curve.csv").write_text(CURVE)
    (folder / "rovid.toml").write_text(actuators + signals)
    for number in range(logs):
        write_log(folder / f"run_{number}.csv", Motion(seed=number), without=(40.0, 55.0))


def read(folder: Path) -> PlanarData:
    """The campaign of a folder."""
    config = load_planar_config(folder / "rovid.toml")
    return planar_data(read_campaign([folder], config), config.vehicle)
