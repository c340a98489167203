"""Every mistake gets one clear message (where, found, wanted, mend), exit status 2, and loses nothing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Done, Rovid

TOML = """
[vehicle]
name = "v"
mass = 2604.0
length = 2.6
width = 2.0
[[thrusters]]
name = "fore"
yaw_arm = 0.86
curve = "curve.csv"
command = { csv = "fore_V" }
[signals]
time = { csv = "time_s" }
heading = { csv = "heading_deg", unit = "deg" }
"""
TIME = np.arange(0.0, 120.0, 0.05)


def good_log(command: float = 1.5, rate: float = 9.0) -> str:
    """A vehicle that turns at a steady ``rate`` in deg/s, with a little noise."""
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(TIME))
    rows = [f"{t:.2f},{(rate * t + e) % 360:.3f},{command}" for t, e in zip(TIME, noise, strict=True)]
    return "time_s,heading_deg,fore_V\n" + "\n".join(rows) + "\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A campaign with nothing wrong: holds at several levels."""
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "rovid.toml").write_text(TOML)
    (tmp_path / "c" / "curve.csv").write_text("command,thrust_N\n-5,-500\n0,0\n5,1000\n")
    for k, (command, rate) in enumerate([(0.5, 5.0), (1.0, 8.0), (1.5, 10.0), (-1.0, -5.0), (-2.0, -8.0)]):
        (tmp_path / "c" / f"hold_{k}.csv").write_text(good_log(command, rate))
    return tmp_path / "c"


def assert_one_message(done: Done, *words: str) -> None:
    assert done.code == 2, done
    assert "Traceback" not in done.err
    assert done.out == ""
    message = done.err.strip()
    assert message.startswith("rovid: ")
    assert "\n" not in message, "one message"
    for word in words:
        assert word.lower() in message.lower(), message


def test_nothing_wrong_passes(folder: Path, rovid: Rovid) -> None:
    assert rovid("fit-drag", folder).code == 0


def change(old: str, new: str) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        path = folder / "rovid.toml"
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))

    return apply


def log(text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / "hold_0.csv").write_text(text)


def edit_log(edit: Callable[[list[str]], list[str]]) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        path = folder / "hold_0.csv"
        path.write_text("\n".join(edit(path.read_text().splitlines())) + "\n")

    return apply


def radians(lines: list[str]) -> list[str]:
    cells = [line.split(",") for line in lines[1:]]
    return [lines[0], *(f"{t},{np.deg2rad(float(h)):.5f},{u}" for t, h, u in cells)]


MISTAKES: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "missing column": (change('"heading_deg"', '"headin_deg"'), ("hold_0.csv", "headin_deg", "'heading_deg'")),
    "missing command column": (change('"fore_V"', '"fore_volt"'), ("hold_0.csv", "fore_volt", "fore_V")),
    "text in a number": (
        edit_log(lambda x: [*x[:16], x[16].replace(x[16].split(",")[1], "N/A"), *x[17:]]),
        ("hold_0.csv:17", "heading_deg", "N/A", "number"),
    ),
    "one sample": (edit_log(lambda x: x[:2]), ("hold_0.csv",)),
    "header only": (edit_log(lambda x: x[:1]), ("hold_0.csv",)),
    "empty file": (log(""), ("hold_0.csv", "empty")),
    "constant heading": (
        edit_log(lambda x: [x[0], *(f"{r.split(',')[0]},123.4,1.5" for r in x[1:])]),
        ("hold_0.csv", "never changes"),
    ),
    "heading in radians declared as degrees": (edit_log(radians), ("hold_0.csv", "rad", "deg")),
    "time backwards": (edit_log(lambda x: [x[0], *x[:0:-1]]), ("hold_0.csv", "backwards")),
    "no thruster curve": (lambda f: (f / "curve.csv").unlink(), ("curve.csv", "fit-thruster")),
    "curve with other columns": (
        lambda f: (f / "curve.csv").write_text("volt,newton\n0,0\n1,1\n"),
        ("curve.csv", "'command'"),
    ),
    "command outside the curve": (
        edit_log(lambda x: [x[0], *(r.replace(",0.5", ",7.5") for r in x[1:])]),
        ("hold_0.csv", "fore", "7.5", "clamp"),
    ),
    "no thrusters and no torque": (
        lambda f: (f / "rovid.toml").write_text('[signals]\nheading = { csv = "heading_deg" }\n'),
        ("[[thrusters]]",),
    ),
    "unknown key": (change("yaw_arm", "yawarm"), ("rovid.toml", "yawarm", "'yaw_arm'")),
    "unknown key of a signal": (
        change('"heading_deg", unit', '"heading_deg", units'),
        ("rovid.toml", "heading", "'units'", "'unit'"),
    ),
    "time that is never known": (
        edit_log(lambda x: [x[0], *(f",{r.partition(',')[2]}" for r in x[1:])]),
        ("hold_0.csv", "time_s", "no time"),
    ),
    "wrong unit": (change('unit = "deg"', 'unit = "grad"'), ("rovid.toml", "heading", "grad", "deg, rad")),
    "not TOML": (change("[vehicle]", "[vehicle"), ("rovid.toml", "TOML")),
    "no heading mapped": (change("heading = {", "heeding = {"), ("rovid.toml", "heading")),
    "negative mass": (change("2604.0", "-1"), ("mass", "positive")),
    "not an MCAP": (lambda f: (f / "a.mcap").write_bytes(b"not an mcap at all, only text"), ("a.mcap", "MCAP")),
    "binary garbage": (lambda f: (f / "hold_0.csv").write_bytes(bytes(range(256)) * 40), ("hold_0.csv",)),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_told(name: str, folder: Path, rovid: Rovid) -> None:
    break_it, words = MISTAKES[name]
    break_it(folder)
    assert_one_message(rovid("fit-drag", folder), *words)
    assert not Path("parameters.toml").exists()


@pytest.mark.parametrize("name", MISTAKES)
def test_check_tells_it_too(name: str, folder: Path, rovid: Rovid) -> None:
    MISTAKES[name][0](folder)
    done = rovid("check", folder)
    assert done.code == 2 or done.out.startswith("No go: ")
    assert "Traceback" not in done.err + done.out


def test_empty_folder(tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "rovid.toml").write_text(TOML)
    (tmp_path / "c" / "curve.csv").write_text("command,thrust_N\n0,0\n5,1000\n")
    assert_one_message(rovid("fit-drag", "c"), "c")


def test_no_such_folder(rovid: Rovid) -> None:
    assert_one_message(rovid("fit-drag", "nowhere"), "nowhere")


def test_no_configuration(tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "hold.csv").write_text(good_log())
    assert_one_message(rovid("fit-drag", "c"), "rovid.toml")


def test_unwritable_output_keeps_what_was_there(folder: Path, rovid: Rovid) -> None:
    (folder / "file").write_text("precious")
    assert_one_message(rovid("fit-drag", folder, "-p", folder / "file" / "parameters.toml"), "cannot be written")
    assert (folder / "file").read_text() == "precious"
    rovid("fit-drag", folder)
    rovid("fit-inertia")
    assert_one_message(rovid("report", "-o", folder / "file"), "cannot be written")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('schema = "rovid-parameters/99"\n', ("newer", "99")),
        ('schema = "something/1"\n', ("something/1", "rovid-parameters/1")),
        ('schema = "rovid-parameters/1"\n', ("damaged", "delete it")),
        ("not toml = = =", ("TOML", "with -p")),
        ("", ("schema", "with -p")),
    ],
)
def test_bad_parameter_files(content: str, words: tuple[str, ...], rovid: Rovid) -> None:
    Path("parameters.toml").write_text(content)
    assert_one_message(rovid("simulate"), "parameters.toml", *words)
    assert Path("parameters.toml").read_text() == content


def test_later_commands_without_parameters_say_what_comes_first(folder: Path, rovid: Rovid) -> None:
    assert_one_message(rovid("simulate"), "fit-drag")
    assert_one_message(rovid("fit-inertia"), "fit-drag")
    assert_one_message(rovid("report"), "fit-drag")
    rovid("fit-drag", folder)
    assert_one_message(rovid("simulate"), "inertia", "fit-inertia")


def test_logs_that_went_away_are_named(folder: Path, rovid: Rovid) -> None:
    rovid("fit-drag", folder)
    shutil.rmtree(folder)
    assert_one_message(rovid("fit-inertia"), "c")


def test_tables_that_a_shell_names_among_logs_are_left_out(folder: Path, rovid: Rovid) -> None:
    (folder / "turns.csv").write_text("command,yaw_rate_rad_s,torque_Nm\n1,0.1,60\n2,0.2,240\n")
    done = rovid("fit-drag", *sorted(folder.glob("*.csv")), "--json")
    alone = rovid("fit-drag", *sorted(folder.glob("hold*.csv")), "--json")
    assert done.document["parameters"] == alone.document["parameters"]
    for name in ("curve.csv", "turns.csv"):
        assert any(name in text and "left out" in text for text in done.document["warnings"])


def test_a_rate_that_is_dead_does_not_hide_the_heading(folder: Path, rovid: Rovid) -> None:
    good = rovid("fit-drag", folder, "--json").document["parameters"]
    for path in folder.glob("hold*.csv"):
        first, *rows = path.read_text().splitlines()
        path.write_text("\n".join([f"{first},rate_dps", *(f"{row},0.0" for row in rows)]) + "\n")
    with (folder / "rovid.toml").open("a") as toml:
        toml.write('yaw_rate = { csv = "rate_dps", unit = "deg/s" }\n')
    document = rovid("fit-drag", folder, "--json").document
    assert document["parameters"] == good
    assert any("rate_dps" in text and "stays the same" in text for text in document["warnings"])


@pytest.mark.slow
def test_parameters_of_a_log_that_changed_are_refused(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    day = shutil.copytree(csv_day, tmp_path / "copy")
    rovid("fit-drag", day)
    rovid("fit-inertia")
    first = next(day.glob("hold*.csv"))
    first.write_text("\n".join(first.read_text().splitlines()[:-100]) + "\n")
    assert_one_message(
        rovid("simulate"), "parameters.toml: is out of date", f"{first.name} has changed", "rovid report"
    )


def test_unknown_options_and_values(folder: Path, rovid: Rovid) -> None:
    assert rovid("fit-drag", folder, "--cutof", "1").code == 2
    assert rovid("fit-drag", folder, "--cutoff", "-1").code == 2
    assert_one_message(rovid("fit-thruster", folder / "hold_0.csv", "--unit", "stone"), "stone", "kgf")


def test_inertia_that_no_vehicle_has(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    day = shutil.copytree(csv_day, tmp_path / "copy")
    toml = (day / "rovid.toml").read_text()
    assert "2604.0" in toml
    (day / "rovid.toml").write_text(toml.replace("2604.0", "26.04"))
    for command in ("fit-drag", "fit-inertia", "fit"):
        assert_one_message(rovid(command, day), "rigid body", "no vehicle has")
