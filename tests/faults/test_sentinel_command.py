"""Values that mean "no command"."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.faults.base import CommandData
from rovid.faults.sentinel_command import DETECTORS
from rovid.trial.vehicle import ThrustCurve, Thruster

TIME: FloatArray = np.linspace(0.0, 39.9, 400)
PULSES = 1500.0 + 300.0 * np.sin(TIME)


def curve(low: float, high: float) -> ThrustCurve:
    return ThrustCurve(command=np.linspace(low, high, 5), thrust=np.array([-20.0, -5.0, 0.0, 5.0, 20.0]))


def data(
    values: FloatArray, points: ThrustCurve | None, source: str = "RCOU.C1", rate: FloatArray | None = None
) -> CommandData:
    thruster = None if points is None else Thruster(name="fore", arm=0.4, curve=points)
    return CommandData(
        log="a.BIN",
        name="fore",
        time=TIME,
        values=values,
        thruster=thruster,
        measured=TIME,
        position=np.zeros(0) if rate is None else np.cumsum(rate) * TIME[1],
        source=source,
    )


@pytest.mark.parametrize("value", [0.0, 65535.0, -1.0])
@pytest.mark.parametrize("rows", [slice(40), slice(100, 120), slice(None)])
def test_no_pulse_is_no_thrust(value: float, rows: slice) -> None:
    values = PULSES.copy()
    values[rows] = value
    (detection,) = DETECTORS["command"][0](data(values, curve(1100.0, 1900.0)))
    fixed = detection.repair(data(values, curve(1100.0, 1900.0))).values
    np.testing.assert_array_equal(fixed[rows], 1500.0)
    np.testing.assert_array_equal(fixed[values == PULSES], PULSES[values == PULSES])
    assert detection.fault.at == pytest.approx((TIME[rows][0],))
    assert detection.fault.size == len(TIME[rows])


def test_nan_stops_a_motor_of_px4() -> None:
    values = np.sin(TIME)
    values[:50] = np.nan
    (detection,) = DETECTORS["command"][0](data(values, curve(-1.0, 1.0), "actuator_motors.control[0]"))
    assert not detection.repair(data(values, curve(-1.0, 1.0))).values[:50].any()
    # Elsewhere an empty cell is no order.
    assert not list(DETECTORS["command"][0](data(values, curve(-1.0, 1.0))))


# Thrust of 0.5 until 10 s, none until 20 s, thrust again; and the rate of a vehicle that follows within 2 s.
STOPPED = (TIME >= 10.0) & (TIME < 20.0)
LEVELS = np.where(STOPPED, np.nan, 0.5)


def following(torque: FloatArray) -> FloatArray:
    rate = np.zeros(len(TIME))
    for at in range(1, len(TIME)):
        rate[at] = rate[at - 1] + (0.4 * torque[at - 1] - rate[at - 1]) * TIME[1] / 2.0
    return rate


def test_nan_is_no_thrust_where_the_vehicle_slows_down() -> None:
    given = data(LEVELS, curve(-1.0, 1.0), "fore_V", following(np.nan_to_num(LEVELS)))
    (detection,) = DETECTORS["command"][0](given)
    fixed = detection.repair(given)
    assert not fixed.values[STOPPED].any()
    assert not fixed.unknown
    assert detection.fault.remedy == "zero"


@pytest.mark.parametrize(
    "values",
    [
        np.where(STOPPED, np.nan, np.where(TIME < 2.0, 0.0, 0.5)),  # No thrust is logged as zero: cells are missing.
        np.where(np.arange(len(TIME)) % 4 > 0, np.nan, 0.5),  # A slower topic.
    ],
)
def test_nan_is_a_missing_cell(values: FloatArray) -> None:
    torque = np.where(STOPPED, 0.0, 0.5)
    assert not list(DETECTORS["command"][0](data(values, curve(-1.0, 1.0), "fore_V", following(torque))))


@pytest.mark.parametrize("torque", [np.full(len(TIME), 0.5), np.where(STOPPED, 1.5, 0.5)])
def test_nan_is_a_missing_cell_where_the_vehicle_goes_on(torque: FloatArray) -> None:
    assert not list(DETECTORS["command"][0](data(LEVELS, curve(-1.0, 1.0), "fore_V", following(torque))))


def test_a_command_is_unknown_where_the_vehicle_gains_speed_without_a_pulse() -> None:
    without = TIME < 10.0
    given = data(np.where(without, 0.0, 1700.0), curve(1100.0, 1900.0), rate=following(np.full(len(TIME), 0.5)))
    (detection,) = DETECTORS["command"][0](given)
    fixed = detection.repair(given)
    assert np.isnan(fixed.values[without]).all()
    assert fixed.unknown == ((0.0, pytest.approx(10.0)),)
    assert detection.fault.remedy == "unknown"
    assert "the vehicle gains speed" in detection.fault.text


@pytest.mark.parametrize(
    ("values", "points"),
    [
        (PULSES, curve(1100.0, 1900.0)),
        (np.sin(TIME), curve(-1.0, 1.0)),
        (np.sign(np.sin(TIME)), curve(0.0, 1.0)),  # Reverse, which the curve lacks.
        (50.0 * np.sin(TIME), curve(1100.0, 1900.0)),  # Percent, and zero among them.
        (np.where(TIME < 4.0, 0.0, 0.5), None),
    ],
)
def test_undamaged_commands(values: FloatArray, points: ThrustCurve | None) -> None:
    assert not list(DETECTORS["command"][0](data(values, points)))


@pytest.mark.parametrize(
    ("command", "thrust", "neutral"),
    [
        ([1100, 1480, 1520, 1900], [-34, 0, 0, 41], 1500.0),
        ([-10, 10], [-50, 50], 0.0),
        ([1000, 2000], [0, 60], 1000.0),
        ([1100, 1900], [-30, 50], 1400.0),
    ],
)
def test_the_neutral_command_of_a_curve(command: list[float], thrust: list[float], neutral: float) -> None:
    assert ThrustCurve(command=np.array(command), thrust=np.array(thrust)).neutral == pytest.approx(neutral)
