"""What a message shows of a text that is not ours: short, visible, with its ends."""

from __future__ import annotations

import math

import pytest

from rovid import effects, export
from rovid.core.errors import ConfigError, RovidError, display_text, suggestion
from rovid.effects import effect_named
from tests.hostile import STEERING


def test_what_is_shown_is_short_visible_and_keeps_its_ends() -> None:
    assert display_text("Übung 走行\u3000می\u200cخواهم.csv") == "Übung 走行\u3000می\u200cخواهم.csv"
    assert display_text("a\x1b[1m\nb\u202e\udcff") == r"a\x1b[1m\nb\u202e\udcff"
    for text in ("x" * 100_000, "\x1b" * 100_000, "ab\x1b" * 90):
        assert len(display_text("<" + text + ">")) <= 200
        assert f"({len(text) + 2} characters)" in display_text("<" + text + ">")
        assert display_text("<" + text + ">")[0] + display_text("<" + text + ">")[-1] == "<>"


def test_no_message_is_long_or_steers() -> None:
    long = "\x1b[31m" + "z" * 100_000
    error = str(RovidError(f"has {long!r} and {long}.", where=long, mend=long))
    assert len(error) <= 2000
    assert not STEERING.search(error)
    assert str(RovidError("m." * 10, where="w", mend="x")) == f"w: {'m.' * 10} x"
    assert len(suggestion(long, [long, long + "a", *(f"{long}{k}" for k in range(20))])) < 1000
    assert suggestion("x", ["\x1b" * 9_000]).count("\\x1b") < 60


def test_an_unknown_key_costs_no_more_for_being_long() -> None:
    with pytest.raises(ConfigError):
        effect_named("e" * 1_000_000)
    assert math.isfinite(len(suggestion("e" * 1_000_000, ["e" * 1_000_000 + str(k) for k in range(50)])))


@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        ("lag", "'thruster_lag'"),
        ("cmd_dly", "'command_delay'"),
        ("delay", "'command_delay'"),
        ("tether", "'tether_torsion'"),
        ("deadzone", "'thruster_deadband'"),
        ("friction", "'coulomb_resistance'"),
        ("thruster_lagg", "'thruster_lag'"),
        ("thruster_lag:roter", "'thruster_lag:rotor'"),
    ],
)
def test_a_near_miss_of_an_effect_is_answered_with_it(wanted: str, found: str) -> None:
    with pytest.raises(ConfigError, match=f"there is no effect '{wanted}'. Nearest: {found}"):
        effect_named(wanted)


def test_other_words_lead_to_names_that_there_are() -> None:
    assert set(effects.SYNONYMS.values()) <= {effect.id for effect in effects.CATALOGUE}
    assert set(export.ALIASES.values()) <= set(export.FORMATS)
    assert suggestion("heading_deg", ["time_s", "hdg", "pitch_deg", "fore_V"]) == "Nearest: 'hdg'."
    assert suggestion("yaw_arms", ["yaw_arm_guessed", "yaw_arm"]) == "Nearest: 'yaw_arm', 'yaw_arm_guessed'."
    assert suggestion("gazebo", export.FORMATS, export.ALIASES) == "Nearest: 'gz-sim'."
    assert suggestion("simulink", export.FORMATS, export.ALIASES) == "Nearest: 'matlab'."
    assert suggestion("zzz", ["a", "b"], {"other": "a"}) == "There are: 'a', 'b'."
