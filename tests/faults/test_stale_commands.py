"""Commands that end before the log, or fall silent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.faults.base import CommandData, RunsData
from rovid.faults.stale_commands import DETECTORS
from rovid.trial.preprocessing import Run, split
from tests.faults.days import day
from tests.faults.drives import drives, found
from tests.readers.logs import read_csv
from tests.synthetic import LOGGED, VEHICLE

MEASURED: FloatArray = np.linspace(0.0, 59.95, 1200)
RNG = np.random.default_rng(1)


def data(time: FloatArray, values: FloatArray, measured: FloatArray = MEASURED) -> CommandData:
    return CommandData(
        log="a.csv", name="fore", time=time, values=values, thruster=VEHICLE.thrusters[0], measured=measured
    )


@pytest.mark.parametrize("interval", [0.05, 0.2, 1.0])
@pytest.mark.parametrize("end", [20.0, 45.0])
def test_commands_that_end_early(interval: float, end: float) -> None:
    time = np.arange(0.0, end, interval)
    for values in (np.where(time % 8.0 < 4.0, 2.0, -2.0), 1.0 + np.sin(time)):
        (detection,) = DETECTORS["command"][0](data(time, values))
        assert detection.fault.at == pytest.approx((time[-1],))
        assert detection.fault.size == pytest.approx(MEASURED[-1] - time[-1])
        assert detection.repair(data(time, values)).unknown == ((pytest.approx(time[-1] + interval), np.inf),)


def test_a_silence_in_between() -> None:
    time = np.arange(0.0, 60.0, 0.2)
    time = time[(time < 30.0) | (time > 36.0)]
    (detection,) = DETECTORS["command"][0](data(time, np.where(time % 8.0 < 4.0, 2.0, -2.0)))
    assert detection.fault.at == pytest.approx((29.8,))
    assert "silent for 6.4 s from 29.8 s" in detection.fault.text
    # A pause of the whole log lacks nothing.
    pause = MEASURED[(MEASURED < 29.9) | (MEASURED > 36.1)]
    assert not list(DETECTORS["command"][0](data(time, np.where(time % 8.0 < 4.0, 2.0, -2.0), pause)))


def test_a_silence_in_a_short_log_is_no_usual_interval() -> None:
    """Of 60 intervals one in a hundred is none."""
    time = 0.4 * np.arange(70.0)
    time = time[(time < 8.5) | (time > 12.7)]
    (detection,) = DETECTORS["command"][0](data(time, np.sin(0.5 * time) + 2.0, np.arange(0.0, 27.6, 0.2)))
    assert detection.fault.size == pytest.approx(4.4)


def only_changes(values: FloatArray) -> CommandData:
    time: FloatArray = np.linspace(0.0, 0.1 * (len(values) - 1), len(values))
    kept = np.diff(values, prepend=np.nan) != 0.0
    return data(time[kept], values[kept])


@pytest.mark.parametrize(
    "undamaged",
    [
        data(MEASURED, np.sin(MEASURED)),
        data(MEASURED[::4], np.sign(np.sin(MEASURED[::4]))),
        only_changes(np.repeat(RNG.choice([-2.0, 0.0, 2.0], 60), 10)),
        only_changes(np.repeat(RNG.uniform(-2.0, 2.0, 20), 30)),
        only_changes(np.concatenate((np.sin(0.1 * np.arange(300)), np.zeros(300)))),
        only_changes(np.concatenate((np.round(np.sin(0.1 * np.arange(300)), 1), np.full(300, 0.5)))),
        data(np.sort(RNG.uniform(0.0, 60.0, 400)), np.ones(400)),
        data(np.array([0.0, 1.3, 1.4, 7.0]), np.array([0.0, 1.0, 2.0, 1.0])),
    ],
)
def test_undamaged_commands(undamaged: CommandData) -> None:
    assert not list(DETECTORS["command"][0](undamaged))


def test_what_follows_is_left_out(tmp_path: Path) -> None:
    drive = dict(drives(1))["staircase 5.0"]
    lines = ["time_s,heading_deg,fore_V"]
    for at, row in enumerate(zip(drive.time, drive.heading % 360.0, drive.command, strict=True)):
        lines.append(f"{row[0]:.2f},{row[1]:.3f},{row[2] if at % 2 == 0 and row[0] < 50.0 else ''}")
    trial = read_csv(tmp_path, "\n".join(lines) + "\n")
    assert len(found(trial, "stale_commands")) == 1
    (part,) = split(trial)
    assert part.duration == pytest.approx(50.0, abs=0.11)


def _frozen(run: Run, begin: float, end: float) -> Run:
    """``run`` whose logger repeats the command of ``begin``, a share of its length, until ``end``."""
    time = run.trial.time / run.trial.time[-1]
    hidden, held = (time > begin) & (time < end), run.trial.commands[np.argmax(time > begin)]
    commands = np.where(hidden[:, np.newaxis], held, run.trial.commands)
    trial = replace(run.trial, commands=commands)
    torque = LOGGED.torque(trial)
    return replace(run, trial=trial, torque=torque, filtered_torque=run.rates.filter_held(trial, torque))


@pytest.mark.parametrize(("vehicle", "log"), [("small", "sine_0.csv"), ("large", "random.csv")])
def test_commands_that_repeat_their_last_value(vehicle: str, log: str) -> None:
    """The vehicle follows a sine, or random commands, that are not logged for a while. Holds are no such commands."""
    runs = day(vehicle, 3)
    assert not list(DETECTORS["runs"][0](RunsData(runs=runs, vehicle=LOGGED)))
    damaged = [_frozen(run, 0.43, 0.68) if run.trial.name == log else run for run in runs]
    (detection,) = DETECTORS["runs"][0](data := RunsData(runs=damaged, vehicle=LOGGED))
    assert detection.fault.logs == (log,)
    assert detection.fault.remedy == "unknown"
    duration = next(run.trial.duration for run in runs if run.trial.name == log)
    dwell = 2.0 * duration / 40.0  # Two random commands may be the same.
    assert detection.fault.at == pytest.approx((0.43 * duration,), abs=dwell)
    assert detection.fault.size == pytest.approx(0.25 * duration, abs=2.0 * dwell)
    assert len(detection.repair(data).runs) == len(runs) + 1


def test_commands_that_repeat_their_last_value_for_longer_than_half_of_the_other_logs() -> None:
    """Three logs have no four stretches as long as that."""
    runs = [run for run in day("large", 3) if run.trial.name in {"random.csv", "sine_1.csv", "hold_2.csv"}]
    assert not list(DETECTORS["runs"][0](RunsData(runs=runs, vehicle=LOGGED)))
    damaged = [_frozen(run, 0.1, 1.1) if run.trial.name == "random.csv" else run for run in runs]
    (detection,) = DETECTORS["runs"][0](RunsData(runs=damaged, vehicle=LOGGED))
    assert detection.fault.logs == ("random.csv",)
