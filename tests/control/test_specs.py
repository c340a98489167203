"""Options of the controller, and its manoeuvres."""

from __future__ import annotations

import math

import pytest

from rovid.control.control_law import ControllerOptions, loop_conditions, standard_manoeuvres
from rovid.core.errors import ConfigError
from tests.control.loops import PAPER


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        ({"kp": 0.0, "kd": 1.0}, "--kp: is 0; a number above zero"),
        ({"period": math.inf}, "--period: is inf"),
        ({"delay": -1.0}, "--delay: is -1; zero or a number above"),
        ({"kp": 1.0}, "--kp: needs the other gain"),
        ({"kd": 1.0}, "--kd: needs the other gain"),
        ({"kp": 1.0, "kd": 1.0, "bandwidth": 0.1}, "--bandwidth: contradicts"),
        ({"steps": ("20-120",)}, "--step: is '20-120'; two headings"),
    ],
)
def test_invalid_options_are_refused(wish: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        ControllerOptions(**wish)  # type: ignore[arg-type]


def test_a_step_turns_the_shorter_way() -> None:
    steps = ControllerOptions(steps=("350:10", "10:350", "0:90")).parsed_steps()
    assert steps == [(350.0, 370.0), (10.0, -10.0), (0.0, 90.0)]
    names = [run.name for run in standard_manoeuvres(steps, 100.0)]
    assert "350 to 10 deg" in names
    assert "10 to 350 deg" in names


def test_waves_and_current_are_a_tenth_of_the_torque_in_use() -> None:
    runs = {run.name: run for run in standard_manoeuvres([], 120.0)}
    assert runs["hold 120 deg, current sets in"].current == pytest.approx(12.0)
    assert runs["hold 120 deg, waves"].waves == pytest.approx(12.0)


def test_without_logs_the_torque_in_use_is_the_drag_of_a_moderate_rate() -> None:
    setting = loop_conditions(ControllerOptions(), PAPER, None, None)
    assert setting.torque_in_use == pytest.approx(3532.0 * 0.15**2 + 132.37 * 0.15)
    assert setting.heading_noise == pytest.approx(math.radians(0.01))
    assert loop_conditions(ControllerOptions(), PAPER, 0.002, 50.0).torque_in_use == 50.0
