"""What is measured along the other axes is known by its name and unit."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.preflight.axis_signal_guess import guessed_along
from rovid.preflight.raw_columns import RawColumn
from rovid.trial.axis import AXES

RNG = np.random.default_rng(2)


def found(axis: str, *names: str, size: float = 1.0) -> dict[str, tuple[str, str, int]]:
    every = {
        name: [RawColumn(source=name, time=np.arange(50.0), values=size * RNG.uniform(-1.0, 1.0, 50))] for name in names
    }
    guesses = guessed_along(AXES[axis], every)
    return {name: (one.source, one.unit, one.sign) for name, one in guesses.items()}


@pytest.mark.parametrize(
    ("axis", "column", "signal", "unit", "sign"),
    [
        ("surge", "surge_velocity_m_s", "surge_velocity", "m/s", 1),
        ("surge", "u_m_s", "surge_velocity", "m/s", 1),
        ("surge", "dvl.vx", "surge_velocity", "m/s", 1),
        ("surge", "Vitesse Avance [m/s]", "surge_velocity", "m/s", 1),
        ("surge", "STW (kn)", "surge_velocity", "kn", 1),
        ("surge", "SurgeMps", "surge_velocity", "m/s", 1),
        ("surge", "surge_position_cm", "surge_position", "cm", 1),
        ("sway", "sway_velocity_mps", "sway_velocity", "m/s", 1),
        ("heave", "Tiefe (m)", "depth", "m", 1),
        ("heave", "profondeur", "depth", "m", 1),
        ("heave", "altitude_m", "depth", "m", -1),
        ("heave", "heave_velocity_m_s", "heave_velocity", "m/s", 1),
        ("roll", "roll_rad", "roll", "rad", 1),
        ("roll", "Krängung [Grad]", "roll", "deg", 1),
        ("roll", "gite_deg", "roll", "deg", 1),
        ("pitch", "assiette (deg)", "pitch", "deg", 1),
    ],
)
def test_usual_names(axis: str, column: str, signal: str, unit: str, sign: int) -> None:
    others = ("heading_deg", "yaw_rate_dps", "port_V", "battery_pct", "vertical_port_pct", "depth_setpoint_m")
    assert found(axis, column, *others)[signal] == (column, unit, sign)


def test_a_rate_stands_beside_a_tilt_and_not_for_it() -> None:
    assert set(found("roll", "roll_deg", "roll_rate_dps")) == {"roll", "roll_rate"}
    assert not found("roll", "roll_rate_dps")


def test_a_tilt_without_unit_is_in_degrees_where_it_is_more_than_upright() -> None:
    assert found("pitch", "pitch", size=12.0)["pitch"][1] == "deg"
    assert found("pitch", "pitch", size=0.4)["pitch"][1] == "rad"


def test_thrusters_are_no_motion() -> None:
    assert not found("heave", "vertical_pct", "motor_vertikal_babord", "heave_cmd")
