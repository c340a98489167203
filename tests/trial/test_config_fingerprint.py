"""What of rovid.toml results rest on: what changes it and what does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from rovid.trial.config import load_config
from rovid.trial.config_fingerprint import ConfigFingerprint

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
