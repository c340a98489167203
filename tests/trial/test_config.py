"""rovid.toml: what is read, and what is refused with its place in the file."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import ConfigError
from rovid.trial.axis import AXES
from rovid.trial.config import find_config, load_config, load_planar_config
from tests.conftest import SAMPLES

GOOD = """
[vehicle]
name = "Test vehicle"
mass = 2604.0
length = 2.6
width = 2.0
[[thrusters]]
name = "fore"
yaw_arm = 0.43
curve = "curve.csv"
command = { csv = "fore_V", mcap = "/fore.data" }
[[thrusters]]
yaw_arm = -0.43
curve = "curve.csv"
command = "aft_V"
outside = "clamp"
[signals]
time = { csv = "time_s" }
heading = { csv = "heading", mcap = "/h.data", unit = "deg", sign = -1 }
yaw_rate = { csv = "r", unit = "deg/s" }
supply_voltage = { csv = "supply" }
"""


def written(folder: Path, text: str = GOOD, curve: str = "command,thrust_N\n-5,-100\n0,0\n5,200\n") -> Path:
    (folder / "curve.csv").write_text(curve)
    path = folder / "rovid.toml"
    path.write_text(text)
    return path


def test_marks_of_guesses_are_read(tmp_path: Path) -> None:
    text = GOOD.replace("yaw_arm = 0.43", "yaw_arm = 0.43\nyaw_arm_guessed = true\ncurve_guessed = true")
    fore, aft = load_config(written(tmp_path, text)).vehicle.thrusters
    assert (fore.arm_guessed, fore.curve_guessed, aft.arm_guessed) == (True, True, False)
    with pytest.raises(ConfigError, match=r"'fore' yaw_arm_guessed: is 'yes'; the guessed value of yaw_arm"):
        load_config(written(tmp_path, text.replace("yaw_arm_guessed = true", "yaw_arm_guessed = 'yes'")))


def test_guessed_shares_of_the_coupled_model_are_named(tmp_path: Path) -> None:
    lines = "surge = 0.7\nsurge_guessed = 0.7\nsway = 0.7\nsway_guessed = 0.7\nyaw_arm = 0.43"
    config = load_planar_config(written(tmp_path, GOOD.replace("yaw_arm = 0.43", lines, 1)))
    assert config.vehicle.assumptions.listing == "surge and sway of fore"


@pytest.mark.parametrize(("arm", "guessed"), [("1.0", True), ("0.43", False)])
def test_a_guess_ends_where_its_value_is_put_right(arm: str, guessed: bool, tmp_path: Path) -> None:
    text = GOOD.replace("yaw_arm = 0.43", f"yaw_arm = {arm}\nyaw_arm_guessed = 1.0")
    assert load_config(written(tmp_path, text)).vehicle.thrusters[0].arm_guessed is guessed


def test_guesses_of_an_older_init_are_known_as_such(tmp_path: Path) -> None:
    head = "# Written by `rovid init`, which looked at 7 logs. Each guess says why: correct what is\n# wrong.\n"
    text = head + GOOD.replace("yaw_arm = 0.43", "yaw_arm = 1.0")
    assert load_config(written(tmp_path, text)).vehicle.assumptions.items == ("yaw_arm of fore",)
    confirmed = text.replace("yaw_arm = 1.0", "yaw_arm = 1.0\nyaw_arm_guessed = false")
    assert not load_config(written(tmp_path, confirmed)).vehicle.assumptions
    assert not load_config(written(tmp_path, "\n" + text)).vehicle.assumptions


def test_everything_is_read(tmp_path: Path) -> None:
    config = load_config(written(tmp_path))
    assert config.vehicle.name == "Test vehicle"
    assert config.vehicle.rigid_body_inertia == pytest.approx(2334.9, abs=0.1)
    fore, aft = config.vehicle.thrusters
    assert (fore.name, fore.arm, fore.clamp) == ("fore", 0.43, False)
    assert (aft.name, aft.arm, aft.clamp) == ("thruster_2", -0.43, True)
    assert fore.torque(np.array([2.5]))[0] == pytest.approx(43.0)
    assert config.signals["heading"].factor == pytest.approx(-math.pi / 180.0)
    assert config.signals["yaw_rate"].factor == pytest.approx(math.pi / 180.0)
    assert set(config.mapped_signals("mcap")) == {"heading", "command.fore"}
    assert set(config.mapped_signals("csv")) == {
        "heading",
        "yaw_rate",
        "supply_voltage",
        "command.fore",
        "command.thruster_2",
    }


def test_a_byte_order_mark_does_not_matter(tmp_path: Path) -> None:
    assert load_config(written(tmp_path, "\ufeff" + GOOD)).vehicle.name == "Test vehicle"


def test_a_logged_torque_takes_the_place_of_thrusters(tmp_path: Path) -> None:
    text = re.sub(r"(?s)\[\[thrusters.*\[signals\]", '[signals]\ntorque = { csv = "T", unit = "kN m" }', GOOD)
    config = load_config(written(tmp_path, text))
    assert [thruster.curve for thruster in config.vehicle.thrusters] == [None]
    assert config.commands[0].factor == 1000.0
    assert "torque" not in config.signals


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass = 2604.0", 'mass = "heavy"', "[vehicle] mass: is 'heavy'; a number"),
        ("mass = 2604.0", "mass = -1", "positive number"),
        ("mass = 2604.0", "mas = 1", "'mas' is not known here. Nearest: 'mass'"),
        ("yaw_arm = 0.43", "yaw_arm = true", "yaw_arm: is True; a number"),
        ("yaw_arm = 0.43", "yaw_arm = nan", "yaw_arm: is nan"),
        ("yaw_arm = 0.43\n", "", "'fore': has no yaw_arm"),
        ('curve = "curve.csv"', 'curve = "none.csv"', "no such thrust curve"),
        ('name = "fore"', 'name = "thruster_2"', "same name"),
        ('outside = "clamp"', 'outside = "guess"', '"refuse" or "clamp"'),
        ('command = "aft_V"', "command = 5", "command: is 5"),
        ('unit = "deg", sign = -1', 'unit = "turns"', "is 'turns'; one of deg, rad"),
        ("sign = -1", "sign = 2", "1 or -1"),
        (GOOD[GOOD.index("heading = {") : GOOD.index('{ csv = "r"')], "course = ", "has no heading"),
        ("[signals]", '[signals]\ntorque = "T"', "is given in addition to [[thrusters]]"),
        ("[vehicle]", "[vehicles]", "'vehicles' is not known here. Nearest: 'vehicle'"),
        ("[signals]", '[signals]\nsurge_vel = "u"', "'surge_vel' is not known here. Nearest: 'surge_velocity'"),
        ("[signals]", '[signals]\nyaw_rtae = "u"', "'yaw_rtae' is not known here. Nearest: 'yaw_rate'"),
        ("[signals]", '[signals]\nsuply_voltage = "u"', "Nearest: 'supply_voltage'"),
        ("[vehicle]", "[vehicle", "is not valid TOML"),
        ("[[thrusters]]", "[thrusters]", "TOML"),
    ],
)
def test_mistakes_are_told_with_their_place(old: str, new: str, words: str, tmp_path: Path) -> None:
    assert old in GOOD
    path = written(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(ConfigError, match=re.escape(words)) as error:
        load_config(path)
    assert str(tmp_path) in str(error.value)


def test_further_channels_may_have_names_near_a_signal(tmp_path: Path) -> None:
    names = ("heading_2", "roll2", "depth_ahead", "surge", "yaw_rate_cmd", "rpm")
    text = GOOD.replace("[signals]", "\n".join(["[signals]", *(f'{name} = "{name}"' for name in names)]), 1)
    assert load_config(written(tmp_path, text)).signals.keys() >= set(names)


def test_the_nearest_file_at_or_above_the_logs_is_taken(tmp_path: Path) -> None:
    written(tmp_path)
    deep = tmp_path / "a" / "b"
    deep.mkdir(parents=True)
    (deep / "log.csv").write_text("")
    assert find_config([deep / "log.csv"]) == tmp_path / "rovid.toml"
    nearer = written(tmp_path / "a")
    assert find_config([deep]) == nearer


@pytest.mark.parametrize(
    ("name", "words"),
    [("gone", "no such file or folder"), ("empty", "holds no logs: .* Put the logs"), ("day", "no rovid.toml here")],
)
def test_missing_logs_and_a_missing_file_are_told_apart(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "day").mkdir()
    (tmp_path / "day" / "log.csv").touch()
    with pytest.raises(ConfigError, match=words):
        find_config([tmp_path / name])


@pytest.mark.parametrize(
    ("sample", "axis"), [("surge_tank", "surge"), ("pitch_tank", "pitch"), ("kvlcc2_roll_decay", "roll")]
)
def test_logs_of_another_axis_ask_for_it_by_name(sample: str, axis: str) -> None:
    path = SAMPLES / sample / "rovid.toml"
    with pytest.raises(ConfigError, match=f"has no heading.* give --axis {axis}, or"):
        load_config(path)
    assert load_config(path, AXES[axis]).axis.name == axis
