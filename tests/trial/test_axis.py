"""Degrees of freedom and the signals that measure them."""

from __future__ import annotations

import math

import pytest

from rovid.core.errors import ConfigError
from rovid.trial.axis import AXES, YAW, axis_named, name_words, other_axes


def test_units_of_a_straight_axis_lose_their_metres_and_radians() -> None:
    units = [AXES["surge"].unit(unit) for unit in ("kg m^2", "N m s^2/rad^2", "N m/rad", "rad/s", "deg")]
    assert units == ["kg", "N s^2/m^2", "N/m", "m/s", "m"]
    assert YAW.unit("N m s^2/rad^2") == "N m s^2/rad^2"


def test_people_read_angles_in_degrees_and_ways_in_metres() -> None:
    assert YAW.to_display(math.pi) == pytest.approx(180.0)
    assert AXES["heave"].to_display(2.0) == 2.0
    assert YAW.to_display(None) is None


def test_an_axis_that_there_is_not_is_refused_with_those_there_are() -> None:
    assert axis_named("pitch").self_righting
    with pytest.raises(ConfigError, match=r"--axis: is 'yew'; one of yaw, .* Nearest: 'yaw'"):
        axis_named("yew")


@pytest.mark.parametrize(
    ("signals", "keys", "axes"),
    [
        (["surge_velocity"], ["name", "surge"], ["surge"]),
        (["depth"], ["name", "heave"], ["heave"]),
        (["north", "east", "heading"], ["surge", "sway"], ["surge", "sway"]),
        (["surge_position", "force"], [], ["surge"]),
        # A tilt alone is a release; beside thrusters that do not tilt it is a further channel.
        (["roll"], [], ["roll"]),
        (["roll", "pitch"], ["yaw_arm"], []),
        (["north", "east"], ["surge"], []),
        (["heading"], ["yaw_arm"], []),
    ],
)
def test_the_axes_that_a_rovid_toml_is_about(signals: list[str], keys: list[str], axes: list[str]) -> None:
    assert other_axes(signals, keys) == axes


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("/phins/heading.data", {"phins", "heading", "data"}),
        ("yawRate_dps", {"yaw", "rate", "dps"}),
        ("RCOU.C1", {"rcou", "c", "1"}),
        ("IMUTemp", {"imu", "temp"}),
        ("Höhe über Grund", {"höhe", "über", "grund"}),
        ("___", set()),
    ],
)
def test_words_end_where_a_reader_sees_them_end(source: str, found: set[str]) -> None:
    assert name_words(source) == found
