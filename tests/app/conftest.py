"""Folders of logs for the page."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.app.served import Served, served
from tests.conftest import SAMPLES

DAY = SAMPLES / "rosub_tank"


def logs_into(folder: Path, *names: str) -> Path:
    """Some logs of the sample day, without its rovid.toml."""
    folder.mkdir(parents=True)
    for name in names or ("hold_03.csv", "sine_40s_a.csv"):
        shutil.copy(DAY / name, folder)
    shutil.copy(DAY / "thrust_curve.csv", folder)
    return folder


def riddle(folder: Path) -> Path:
    """Logs with meaningless names: heading a without jumps, commands b and c, and other columns."""
    folder.mkdir(parents=True)
    for name in ("hold_03.csv", "hold_05.csv", "sine_40s_a.csv", "staircase.csv"):
        rows = np.genfromtxt(DAY / name, delimiter=",", names=True)
        columns = (
            rows["time_s"],
            np.unwrap(rows["heading_deg"], period=360.0),
            rows["fore_V"],
            rows["aft_V"],
            rows["supply_V"],
        )
        text = "\n".join(",".join(f"{value:.4f}" for value in row) for row in zip(*columns, strict=True))
        (folder / name).write_text(f"time_s,a,b,c,d\n{text}\n")
    return folder


@pytest.fixture(scope="module")
def top(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with a folder of logs in it."""
    folder = tmp_path_factory.mktemp("app") / "top"
    logs_into(folder / "day")
    return folder


@pytest.fixture(scope="module")
def server(top: Path) -> Iterator[Served]:
    """One page for all tests of a file, which do not change the folder."""
    with served(top) as one:
        yield one
