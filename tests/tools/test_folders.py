"""Made-up folders hold what is said of them, whatever the seed."""

from __future__ import annotations

import csv
import json
import secrets
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from tools.folders import Folder, write_folder
from tools.truth import FloatArray

# A simulator of the tests changes rarely, and none of rovid's code is tested here.
pytestmark = pytest.mark.slow

SURE = 4.0  # standard errors; the errors of neighbours are alike, so that these are not quite what they say


def table(path: Path) -> dict[str, FloatArray]:
    """Columns of a log, by another reader than rovid's; an empty cell is nan."""
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("cp1252")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    delimiter = max(",;\t", key=lines[0].count)
    header, *rows = csv.reader(lines, delimiter=delimiter)
    return {name: np.array([number(row[k]) for row in rows]) for k, name in enumerate(header)}


def number(cell: str) -> float:
    if cell.count(":") == 2:
        return datetime.fromisoformat(cell).timestamp()
    return float(cell.replace(",", ".")) if cell else np.nan


def messages(path: Path) -> dict[str, FloatArray]:
    """Fields of a recording, and the time as ""."""
    found: dict[str, list[float]] = {"": []}
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            ((field, value),) = json.loads(message.data).items()
            found.setdefault(f"{channel.topic}.{field}", []).append(value)
            if not found[""] or message.log_time / 1e9 > found[""][-1]:
                found[""].append(message.log_time / 1e9)
    return {name: np.array(values) for name, values in found.items()}


def logs_of(folder: Path) -> list[dict[str, FloatArray]]:
    return [messages(path) if path.suffix == ".mcap" else table(path) for path in sorted(folder.iterdir())]


def turned(log: dict[str, FloatArray], truth: Folder) -> tuple[FloatArray, FloatArray]:
    """Yaw accelerations, and what might have caused them: each thruster, drag, a constant torque."""
    time = log[truth.time] * (1e-3 if truth.time_unit == "ms" or log[truth.time][-1] > 1e11 else 1.0)
    step = (time[-1] - time[0]) / (len(time) - 1)
    heading = log[truth.heading] if truth.heading_unit == "rad" else np.radians(log[truth.heading])
    known = np.flatnonzero(np.isfinite(heading))
    heading = np.interp(np.arange(len(heading)), known, np.unwrap(heading[known]))
    span = round(0.5 / step)
    weight = np.convolve(np.ones(span), np.ones(span)) / span**2
    acceleration = (heading[2 * span :] - 2.0 * heading[span:-span] + heading[: -2 * span]) / (span * step) ** 2
    rate = (heading[2 * span :] - heading[: -2 * span]) / (2.0 * span * step)
    commands = [np.convolve(log[name] - truth.neutral, weight, "same")[span:-span] for name in truth.thrusters]
    rows = np.column_stack([*commands, rate, np.abs(rate) * rate, np.ones(len(rate))])
    return acceleration[::span], rows[::span]


def senses(logs: list[dict[str, FloatArray]], truth: Folder) -> dict[str, float]:
    """Each thruster's effect over its standard error. Thrusters that run together share what they do."""
    pairs = [turned(log, truth) for log in logs if truth.heading in log]
    acceleration, rows = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    count = len(truth.thrusters)
    square = rows.T @ rows
    ridge = np.zeros_like(square)
    ridge[:count, :count] = 0.03 * np.trace(square[:count, :count]) / count * np.eye(count)
    inverse = np.linalg.pinv(square + ridge, hermitian=True)
    effect = inverse @ (rows.T @ acceleration)
    spread = np.sqrt(np.diag(inverse @ square @ inverse) * np.var(acceleration - rows @ effect))
    return dict(zip(truth.thrusters, (effect / spread).tolist(), strict=False))


@pytest.mark.parametrize("index", [0, 3, 4, 7, 13, 29])
def test_a_folder_holds_what_is_said_of_it(index: int, tmp_path: Path) -> None:
    seed = secrets.randbelow(10**6)
    truth = write_folder(tmp_path, seed=seed, index=index)
    logs = logs_of(tmp_path)
    told = f"seed {seed}: {truth}"
    columns = {name for log in logs for name in log}
    assert {*truth.thrusters, *truth.decoys, truth.heading, truth.time, truth.yaw_rate} - {""} <= columns, told
    assert all(truth.time in log and (np.diff(log[truth.time]) > 0.0).all() for log in logs), told
    assert not set(truth.thrusters) & set(truth.decoys), told
    if truth.lacking:
        assert not truth.heading, told
        return
    headings = [log[truth.heading] for log in logs if truth.heading in log]
    turn = 360.0 if truth.heading_unit == "deg" else 2.0 * np.pi
    assert 0.3 * turn < max(map(np.nanmax, headings)) - min(map(np.nanmin, headings)) <= 1.001 * turn, told
    if truth.split:
        assert not any(truth.heading in log and set(truth.thrusters) & set(log) for log in logs), told
        return
    found = senses(logs, truth)
    wrong = [name for name, way in truth.thrusters.items() if way and found[name] * way < -SURE]
    assert not wrong, f"{told} {found}"
    turning = [found[name] * way for name, way in truth.thrusters.items() if way]
    # Judged all together, for a tunnel thruster turns its vessel little.
    assert sum(turning) > SURE * np.sqrt(len(turning)), f"{told} {found}"


def test_the_same_seed_makes_the_same_folder(tmp_path: Path) -> None:
    truths = [write_folder(tmp_path / name, seed=5, index=8) for name in ("one", "other")]
    assert truths[0] == truths[1]
    files = [{path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in ("one", "other")]
    assert files[0] == files[1]
    other = write_folder(tmp_path / "new", seed=6, index=8)
    assert other != truths[0]
