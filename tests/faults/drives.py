"""Undamaged logs of vehicles of many sizes, simulated step by step, for the tests of detectors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.trial.fault import Fault
from rovid.trial.trial import Trial
from tests.readers.logs import csv_text, read_csv


@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """A drive: ``time`` in s, unwrapped ``heading`` in deg, ``command`` in V."""

    time: FloatArray
    heading: FloatArray
    command: FloatArray

    def with_step(self, at: int, degrees: float) -> Drive:
        """The drive whose heading jumps before reading ``at``."""
        return replace(self, heading=self.heading + degrees * (np.arange(len(self.time)) >= at))

    def trial(self, folder: Path, name: str = "run_3.csv", heading: FloatArray | list[str] | None = None) -> Trial:
        """The drive, written as a table and read."""
        columns = {"time_s": self.time, "heading_deg": self.heading % 360.0 if heading is None else heading}
        return read_csv(folder, csv_text(columns | {"fore_V": self.command}), name=name)


# Name -> commanded voltage at (n,) s, from (n,) times and a random generator.
def commands(time: FloatArray, rng: np.random.Generator) -> Mapping[str, FloatArray]:
    """Orders of usual tests."""
    levels = np.repeat(rng.choice([-2.0, 2.0], len(time)), 1)[(time / 1.7).astype(int)]
    staircase = np.repeat(rng.uniform(-2.0, 2.0, len(time)), 1)[(time / 7.0).astype(int)]
    return {
        "sine": 2.0 * np.sin(2.0 * np.pi * time / 12.0),
        "prbs": levels,
        "staircase": staircase,
        "coast": np.where(time < 0.4 * time[-1], 2.0, 0.0),
        "pulse": np.where(np.abs(time - 0.5 * time[-1]) < 0.5 * time[1], 2.0, 0.0),
    }


def drives(seed: int, interval: float = 0.1, count: int = 600, noise: float = 0.02) -> Iterator[tuple[str, Drive]]:
    """Drives of a slow and of fast vehicles, each with its name."""
    rng = np.random.default_rng(seed)
    time: FloatArray = np.linspace(0.0, interval * (count - 1), count)
    for settling in (0.05, 0.5, 5.0):
        for name, command in commands(time, rng).items():
            rate, final = np.zeros(count), rng.uniform(10.0, 60.0)
            heading = np.zeros(count)
            fade = np.exp(-interval / settling)
            for k in range(1, count):
                target = final * command[k - 1]
                rate[k] = target + (rate[k - 1] - target) * fade
                heading[k] = heading[k - 1] + target * interval + (rate[k - 1] - target) * settling * (1.0 - fade)
            heading += rng.uniform(0.0, 360.0) + rng.normal(0.0, noise, count)
            yield f"{name} {settling}", Drive(time=time, heading=heading, command=command)


def found(trial: Trial, name: str) -> list[Fault]:
    """The faults of the kind ``name``."""
    return [fault for fault in trial.faults if fault.fault == name]


def undamaged(seed: int, folder: Path) -> Iterator[tuple[str, Trial]]:
    """Trials without faults: 10 Hz and 1 Hz, fine and coarse headings."""
    for interval, count in ((0.1, 600), (1.0, 200)):
        for decimals in (3, 0):
            for name, drive in drives(seed, interval, count):
                coarse = replace(drive, heading=np.round(drive.heading, decimals))
                if np.ptp(coarse.heading) > 0.0:
                    yield f"{name}, {interval} s, {decimals} decimals", coarse.trial(folder)
