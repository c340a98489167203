"""Names of parameters, and their units."""

from __future__ import annotations

import pytest

from rovid.core.errors import ConfigError
from rovid.model.parameter_names import base_names, effect_ids, unit_of, without_form
from rovid.trial.axis import AXES, YAW


def test_a_self_righting_axis_has_a_stiffness() -> None:
    assert base_names(YAW) == ("inertia", "quadratic_drag", "linear_drag")
    assert "restoring_stiffness" in base_names(AXES["roll"])
    assert "net_buoyancy" in base_names(AXES["heave"])


@pytest.mark.parametrize(
    ("name", "axis", "unit"),
    [
        ("inertia", "yaw", "kg m^2"),
        ("inertia", "surge", "kg"),
        ("thruster_lag.time_constant", "surge", "s"),
        ("bias_torque.torque", "yaw", "N m"),
        ("bias_torque.torque", "heave", "N"),
        # A frequency counts radians along any axis.
        ("wave_torque.frequency", "heave", "rad/s"),
        ("restoring_stiffness", "roll", "N m/rad"),
    ],
)
def test_units_follow_the_axis(name: str, axis: str, unit: str) -> None:
    assert unit_of(name, AXES[axis]) == unit


def test_an_unknown_effect_has_no_unit() -> None:
    with pytest.raises(ConfigError, match="no effect 'thruster_lagg'"):
        unit_of("thruster_lagg.time_constant")


def test_effect_ids_from_parameter_names() -> None:
    names = ["inertia", "thruster_lag:command.time_constant", "wave_torque.amplitude", "wave_torque.frequency"]
    assert effect_ids(names) == ["thruster_lag:command", "wave_torque"]
    assert without_form(names[1]) == "thruster_lag.time_constant"
    assert without_form("inertia") == "inertia"
