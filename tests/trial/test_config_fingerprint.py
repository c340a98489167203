"""Settings that results depend on, and guesses among them."""

from __future__ import annotations

from pathlib import Path

import pytest

from rovid.trial.assumptions import Assumptions, ConfigFingerprint
from rovid.trial.config import load_config

TOML = """
[vehicle]
name = "v"

[[thrusters]]
name = "fore"
yaw_arm = 0.43
curve = "curve.csv"
command = { csv = "fore_V" }

[signals]
time = { csv = "time_s" }
heading = { csv = "heading_deg", unit = "deg" }
"""
CURVE = "command,thrust_N\n-5,-500\n0,0\n5,1000\n"


def settings(folder: Path, toml: str = TOML, curve: str = CURVE) -> ConfigFingerprint:
    (folder / "curve.csv").write_text(curve)
    (folder / "rovid.toml").write_text(toml)
    return load_config(folder / "rovid.toml").fingerprint


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("0.43", "0.44", ["yaw_arm of fore was 0.43 and is 0.44"]),
        ('"curve.csv"', '"curve.csv"\noutside = "clamp"', ["outside of fore was refuse and is clamp"]),
        ('csv = "fore_V"', 'csv = "aft_V"', ["command of fore was csv fore_V and is csv aft_V"]),
        (
            'unit = "deg"',
            'unit = "deg", sign = -1',
            ["heading was csv heading_deg, deg and is csv heading_deg, deg, turned around"],
        ),
        ("[signals]", '[signals]\nroll = "r"', ["roll is new"]),
        ('time = { csv = "time_s" }', "", ["time was csv time_s, auto and is auto"]),
        # What the torque and the signals do not come of.
        ('name = "v"', 'name = "w"\nmass = 10.0  # a comment', []),
        ("[signals]", '[signals]\ntemperature = "t"', []),
    ],
)
def test_what_has_changed_is_told(old: str, new: str, said: list[str], tmp_path: Path) -> None:
    before = settings(tmp_path)
    assert old in TOML
    assert before.changes(settings(tmp_path, TOML.replace(old, new))) == said


def test_a_curve_is_known_by_its_points(tmp_path: Path) -> None:
    before = settings(tmp_path)
    assert before.changes(settings(tmp_path, curve=CURVE.replace("\n", "\r\n"))) == []
    assert before.changes(settings(tmp_path, curve=CURVE.replace("1000", "1001"))) == ["curve of fore has changed"]


def test_thrusters_come_and_go(tmp_path: Path) -> None:
    block = TOML[TOML.index("[[thrusters]]") : TOML.index("[signals]")]
    one, two = settings(tmp_path), settings(tmp_path, TOML + block.replace('"fore"', '"aft"'))
    assert one.changes(two) == ["aft is new"]
    assert two.changes(one) == ["aft is gone"]


def test_the_drive_alone_may_be_asked_for(tmp_path: Path) -> None:
    before, other = settings(tmp_path), settings(tmp_path, TOML.replace("heading_deg", "psi").replace("0.43", "0.5"))
    assert before.changes(other, drive_alone=True) == ["yaw_arm of fore was 0.43 and is 0.5"]


def test_marks_of_a_guess_are_kept_and_change_nothing(tmp_path: Path) -> None:
    measured = settings(tmp_path)
    guessed = settings(tmp_path, TOML.replace("yaw_arm = 0.43", "yaw_arm = 0.43\nyaw_arm_guessed = true"))
    assert guessed.guessed == ("yaw_arm of fore",)
    assert guessed.assumptions.ratios_hold
    assert guessed.changes(measured) == []
    assert not measured.assumptions


ARMS = Assumptions(items=("yaw_arm of fore", "yaw_arm of aft"), thrusters=2)
ONE_OF_TWO = Assumptions(items=("yaw_arm of fore",), thrusters=2)
ALONE = Assumptions(items=("yaw_arm of aft",), thrusters=1)
GUESSED_CURVE = Assumptions(items=("yaw_arm of fore", "curve of fore"), thrusters=1)


def test_nothing_guessed_is_nothing_said() -> None:
    none = Assumptions(thrusters=2)
    assert not none
    assert (none.caution, none.refusal, none.effect_caveat("thruster_imbalance")) == ("", "", "")
    assert not none.is_placeholder("N m")


@pytest.mark.parametrize("guess", [ARMS, ALONE])
def test_arms_are_one_factor_of_all_torque(guess: Assumptions) -> None:
    marked = [
        unit
        for unit in ("kg m^2", "kg m²", "N m s/rad", "N m", "N", "s", "1", "rad/s", "m")
        if guess.is_placeholder(unit)
    ]
    assert marked == ["kg m^2", "kg m²", "N m s/rad", "N m", "N"]
    assert guess.ratios_hold


@pytest.mark.parametrize("guess", [ONE_OF_TWO, GUESSED_CURVE])
def test_of_a_wrong_shape_nothing_holds(guess: Assumptions) -> None:
    assert not guess.ratios_hold
    assert guess.is_placeholder("s")
    assert "ratios are placeholders" in guess.caution


def test_the_caution_says_what_is_guessed_and_what_ratios_ask_for() -> None:
    assert ARMS.caution.startswith("Guessed by rovid init, not measured: yaw_arm of fore and aft. ")
    assert "if these arms are equal in size" in ARMS.caution
    assert ALONE.caution.endswith("ratios and times hold.")
    assert GUESSED_CURVE.listing == "yaw_arm and curve of fore"
    assert (
        Assumptions(items=(*ARMS.items, "curve of aft"), thrusters=2).listing
        == "yaw_arm of fore and aft and curve of aft"
    )
    assert (GUESSED_CURVE.curve_clause, ARMS.curve_clause) == (", with a guessed thrust curve,", "")


@pytest.mark.parametrize(
    ("guess", "effect", "blamed"),
    [
        (GUESSED_CURVE, "command_delay", True),
        (ARMS, "thruster_imbalance", True),
        (ARMS, "command_delay", False),
        (ALONE, "thruster_imbalance", False),
    ],
)
def test_a_cause_that_may_be_the_guess_is_blamed_on_it(guess: Assumptions, effect: str, blamed: bool) -> None:
    assert bool(guess.effect_caveat(effect)) is blamed


def test_two_guesses_together_are_each_said_once() -> None:
    assert (ONE_OF_TWO | ARMS).items == ARMS.items
