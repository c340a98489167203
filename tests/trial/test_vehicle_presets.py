"""Types of vehicles that rovid knows, and those that a user describes."""

from __future__ import annotations

from pathlib import Path

import pytest

from rovid.core.errors import ConfigError
from rovid.trial.tables import read_curve
from rovid.trial.vehicle_presets import load_preset, preset_names


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
