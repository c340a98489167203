"""Vehicles, and published data of known types."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.trial.tables import read_curve
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle, box_inertia
from rovid.trial.vehicle_presets import load_preset, preset_names
from tests.synthetic import LOGGED, trial

CURVE = ThrustCurve(command=np.array([-2.0, -0.5, 0.5, 2.0]), thrust=np.array([-30.0, 0.0, 0.0, 60.0]))


def log(*commands: FloatArray) -> Trial:
    time = np.arange(len(commands[0])) / 10.0
    return Trial(
        name="log.csv", path=trial(time, time).path, time=time, position=0.0 * time, commands=np.column_stack(commands)
    )


def vehicle(*arms: float, clamp: bool = False) -> Vehicle:
    thrusters = tuple(Thruster(name=f"t{k}", arm=arm, curve=CURVE, clamp=clamp) for k, arm in enumerate(arms))
    return Vehicle(name="v", thrusters=thrusters)


@pytest.mark.parametrize(
    ("command", "thrust"), [(0.0, 0.0), (0.4, 0.0), (1.25, 30.0), (2.0, 60.0), (-1.25, -15.0), (-2.0, -30.0)]
)
def test_thrust_is_linear_between_bench_points(command: float, thrust: float) -> None:
    assert CURVE(command) == pytest.approx(thrust)


def test_torque_is_the_sum_over_signed_arms() -> None:
    volts = np.array([0.0, 2.0, -2.0])
    assert vehicle(0.4).torque(log(volts)) == pytest.approx([0.0, 24.0, -12.0])
    assert vehicle(0.4, -0.4).torque(log(volts, -volts)) == pytest.approx([0.0, 24.0 + 12.0, -12.0 - 24.0])
    assert vehicle(0.4, -0.4).torque(log(volts, volts)) == pytest.approx([0.0, 0.0, 0.0])


def test_a_logged_torque_is_taken_as_it_is() -> None:
    assert LOGGED.torque(log(np.array([-300.0, 1e6]))) == pytest.approx([-300.0, 1e6])


def test_outside_the_curve_is_refused_with_place_and_number() -> None:
    with pytest.raises(ConfigError, match=r"log\.csv: thruster 't1' is commanded 2\.5 at 0\.20 s \(2 samples") as error:
        vehicle(0.4, 0.4).torque(log(np.zeros(4), np.array([0.0, 2.1, 2.5, -1.0])))
    assert 'outside = "clamp"' in str(error.value)


def test_outside_the_curve_holds_its_end_value_where_that_is_allowed() -> None:
    assert vehicle(0.5, clamp=True).torque(log(np.array([3.0, -9.0]))) == pytest.approx([30.0, -15.0])


def test_rounding_of_the_log_is_not_outside() -> None:
    assert CURVE.excess(np.array([2.003])) == 0.0
    assert CURVE.excess(np.array([2.005])) == pytest.approx(0.005)
    assert CURVE.excess(np.array([np.nan])) == 0.0


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"mass": 2604.0, "length": 2.6, "width": 2.0}, 2335.0),  # EFFECTS 1.4
        ({"mass": 2604.0, "length": 2.6}, None),
        ({"mass": 2604.0, "length": 2.6, "width": 2.0, "rigid_body_inertia": 2000.0}, 2000.0),
    ],
)
def test_rigid_body_inertia_is_a_box_unless_it_is_given(given: dict[str, Any], expected: float | None) -> None:
    found = Vehicle(name="v", thrusters=(), **given).rigid_body_inertia
    assert found == (None if expected is None else pytest.approx(expected, abs=0.5))
    assert box_inertia(12.0, 1.0, 2.0) == pytest.approx(5.0)


def test_full_thrust_is_the_curves_or_the_largest_that_was_logged() -> None:
    trials = [log(np.array([0.0, 30.0])), log(np.array([-70.0, 5.0]))]
    assert LOGGED.with_logged_torque(trials).thrusters[0].full_thrust == 70.0
    assert LOGGED.with_logged_torque([log(np.zeros(2))]).thrusters[0].full_thrust == 1.0
    assert vehicle(1.0).with_logged_torque(trials).thrusters[0].full_thrust == 60.0


@pytest.mark.parametrize("name", preset_names())
def test_each_type_says_where_its_figures_come_from(name: str) -> None:
    known = load_preset(name)
    assert known.sources
    assert known.arms
    if known.curve is not None:
        assert read_curve(known.curve).span > 0.0


@pytest.mark.parametrize("asked", ["bluerov2-heavy", "BlueROV2 Heavy", "bluerov2_heavy"])
def test_a_type_is_found_however_it_is_spelt(asked: str) -> None:
    assert load_preset(asked).id == "bluerov2-heavy"


def test_thrusters_are_known_by_number_or_side() -> None:
    assert load_preset("bluerov2").label({"pwm", "3", "us"}) == "3"
    assert load_preset("bluerov2").label({"pwm", "6", "us"}) == "6"  # a vertical motor, without an arm
    assert load_preset("heron").label({"stbd", "cmd"}) == "starboard"
    assert not load_preset("heron").label({"bow"})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mass = 3\n", "has no [arms]"),
        ("[arms]\nport = 'far'\n", "has no [arms]"),
        ("mass = -3\n[arms]\nport = 0.3\n", "a positive number was expected"),
        ("weight = 3\n[arms]\nport = 0.3\n", "'weight'"),
        ("curve = 'none.csv'\n[arms]\nport = 0.3\n", "the name of a file in the same folder"),
        ("sources = 3\n[arms]\nport = 0.3\n", "a list of texts"),
    ],
)
def test_a_file_that_describes_no_vehicle_is_refused(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ConfigError, match=r"mine\.toml") as refused:
        load_preset(str(tmp_path / "mine.toml"))
    assert words in str(refused.value)


def test_a_vehicle_of_ones_own_stands_in_a_file(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("mass = 3\nsources = ['weighed']\n[arms]\nport = 0.3\nstarboard = -0.3\n")
    own = load_preset(str(tmp_path / "mine.toml"))
    assert (own.id, own.mass, own.arms["starboard"]) == ("mine", 3.0, -0.3)


def test_an_unknown_type_is_answered_with_the_nearest() -> None:
    with pytest.raises(ConfigError, match="bluerov2"):
        load_preset("blurov2")
