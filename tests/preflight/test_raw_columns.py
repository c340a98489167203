"""Mean rates from irregular, damaged or few samples; units and yaw rates by name."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.preflight.raw_columns import RawColumn, SignalGuess, ending_unit, held_mean, is_yaw_rate, mean_rates

HEADING = SignalGuess(source="heading", unit="deg", reason="")


def test_rates_continue_over_a_whole_turn_and_a_damaged_time_stamp() -> None:
    time = np.arange(0.0, 60.0, 0.1)
    values = (20.0 * time) % 360.0
    stamps = np.where(np.arange(len(time)) == 300, -1e9, time)
    _, rate = mean_rates(HEADING, RawColumn(source="heading", time=stamps, values=values))
    assert rate == pytest.approx(np.radians(20.0), rel=1e-6)


def test_few_samples_give_no_rate() -> None:
    time = np.arange(10.0)
    assert mean_rates(HEADING, RawColumn(source="heading", time=time, values=time))[1].size == 0


def test_means_are_those_of_a_zero_order_hold() -> None:
    time, values = np.array([0.0, 1.0, 3.0]), np.array([2.0, 4.0, 0.0])
    assert held_mean(time, values, np.array([0.0, 2.0, 4.0])) == pytest.approx([3.0, 2.0])


@pytest.mark.parametrize(
    ("name", "unit", "is_rate"),
    [("/u_m_s.data", "m/s", False), ("/dvl.value[1]", "", False), ("/r_rad_s.data", "rad/s", True),
     ("r_deg_s", "deg/s", True), ("wheel_r_rad_s", "rad/s", False)],
)  # fmt: skip
def test_a_name_has_a_unit_ahead_of_the_field_of_its_message(name: str, unit: str, is_rate: bool) -> None:
    assert (ending_unit(name), is_yaw_rate(name)) == (unit, is_rate)
