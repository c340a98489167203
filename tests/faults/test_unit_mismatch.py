"""Commands and curve of different units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.faults.base import CampaignData, examine
from rovid.faults.unit_mismatch import DETECTORS
from rovid.trial.axis import AXES
from rovid.trial.fault import Fault, FaultOverrides
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tests.synthetic import clock, trial

TIME: FloatArray = np.linspace(0.0, 39.9, 400)
SINE = np.sin(TIME)
UNITS = {"-1 to 1": (-1.0, 1.0), "volts": (-10.0, 10.0), "percent": (-100.0, 100.0), "microseconds": (1100.0, 1900.0)}


def examined(commands: FloatArray, low: float, high: float, *, clamp: bool = False) -> list[Fault]:
    points = ThrustCurve(command=np.array([low, high]), thrust=np.array([-20.0, 20.0]))
    vehicle = Vehicle(name="v", thrusters=(Thruster(name="fore", arm=0.4, curve=points, clamp=clamp),))
    data = CampaignData(trials=[trial(TIME, commands, name=name) for name in ("a", "b")], vehicle=vehicle)
    return [detection.fault for detection in DETECTORS["campaign"][1](data)]


def commands(unit: str, share: float = 1.0) -> FloatArray:
    low, high = UNITS[unit]
    values: FloatArray = 0.5 * (low + high) + share * 0.5 * (high - low) * SINE
    return values


@pytest.mark.parametrize(
    ("unit", "curve", "words"),
    [
        ("percent", "volts", "look like percent, the curve like volts. Multiply the commands of the curve by 10,"),
        ("percent", "-1 to 1", "look like percent, the curve like a share of full thrust (-1 to 1). Multiply"),
        ("volts", "-1 to 1", "look like volts"),
        ("microseconds", "-1 to 1", "a pulse width is about 1500 + 400 * curve command"),
        ("-1 to 1", "microseconds", "a pulse width is about 1500 + 400 * command"),
        ("percent", "microseconds", "a pulse width is about 1500 + 4 * command"),
        ("-1 to 1", "percent", "Multiply the commands of the curve by 0.01"),
    ],
)
def test_the_unit_that_would_fit_is_named(unit: str, curve: str, words: str) -> None:
    (fault,) = examined(commands(unit), *UNITS[curve])
    assert fault.stops
    assert fault.logs == ("a", "b")
    assert words in fault.text
    assert "clamp" not in fault.text


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("share", [0.03, 0.3, 1.0, 1.3])
def test_commands_of_the_unit_of_the_curve(unit: str, share: float) -> None:
    assert not examined(commands(unit, share), *UNITS[unit])


def test_overdrive_that_is_clamped_on_purpose() -> None:
    assert not examined(24.0 * SINE, -10.0, 10.0, clamp=True)
    assert examined(100.0 * SINE, -10.0, 10.0, clamp=True)


def test_clamp_is_advised_near_the_curve_only() -> None:
    points = ThrustCurve(command=np.array([-10.0, 10.0]), thrust=np.array([-20.0, 20.0]))
    vehicle = Vehicle(name="v", thrusters=(Thruster(name="fore", arm=0.4, curve=points),))
    for largest, is_advised in ((12.0, True), (100.0, False)):
        with pytest.raises(ConfigError) as error:
            vehicle.torque(trial(TIME, largest * SINE))
        assert ("clamp" in str(error.value)) == is_advised


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_a_log_whose_time_is_in_another_unit(factor: float) -> None:
    """A rate or a length of its own shows no other unit."""
    logs = [trial(TIME[::step], SINE[::step], name=f"{step}") for step in (1, 2, 3)]
    data = CampaignData(trials=[*logs, trial(factor * TIME, SINE, name="odd")], vehicle=Vehicle(name="v", thrusters=()))
    detect = DETECTORS["campaign"][0]
    (found,) = detect(data)
    assert (found.fault.logs, found.fault.size) == (("odd",), factor)
    assert [each.name for each in found.repair(data).trials] == ["1", "2", "3"]
    long = trial(np.linspace(0.0, 4e4, 40_000), np.zeros(40_000), name="long")
    slow = trial(100.0 * TIME[::10], SINE[::10], name="slow")
    assert not list(detect(replace(data, trials=[*logs, long, slow])))


def _decay(name: str, factor: float) -> Trial:
    """Free decay in roll whose time is ``factor`` times as long."""
    time = clock(80.0)
    roll = 0.2 * np.exp(-time / 25.0) * np.cos(2.0 * time)
    one = replace(trial(factor * time, np.zeros(len(time)), roll, name=name), axis=AXES["roll"])
    return replace(one, commands=np.zeros((len(time), 0)))


@pytest.mark.parametrize(("factor", "found"), [(8.246, True), (0.121, True), (1.2, False)])
def test_a_decay_on_another_time_scale(factor: float, found: bool) -> None:
    trials = [_decay("a", 1.0), _decay("b", 1.05), _decay("odd", factor)]
    data = CampaignData(trials=trials, vehicle=Vehicle(name="v", thrusters=()))
    kept, faults = examine(DETECTORS["campaign"], data, FaultOverrides())
    assert [fault.logs for fault in faults] == ([("odd",)] if found else [])
    assert [one.name for one in kept.trials] == ["a", "b"] + ["odd"] * (not found)
    if found:
        assert faults[0].size == pytest.approx(factor / 1.025, rel=0.03)
