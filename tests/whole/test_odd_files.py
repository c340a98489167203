"""What is no file among the logs, or in the place of one: said, never waited for."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.conftest import Rovid
from tests.readers.recordings import iso, sentence
from tests.whole.test_bad_input import TOML, assert_one_message, good_log


@pytest.fixture(autouse=True)
def impatience() -> Iterator[None]:
    """A pipe that is opened would be waited for without end."""

    def stop(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    day = tmp_path / "day"
    day.mkdir()
    (day / "rovid.toml").write_text(TOML)
    (day / "curve.csv").write_text("command,thrust_N\n-5,-500\n0,0\n5,1000\n")
    for k, (command, rate) in enumerate([(0.5, 5.0), (1.0, 8.0), (1.5, 10.0), (-1.0, -5.0), (-2.0, -8.0)]):
        (day / f"hold_{k}.csv").write_text(good_log(command, rate))
    return day


def pipe(path: Path) -> None:
    os.mkfifo(path)


def listening(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # the name of a socket is short
    try:
        with socket.socket(socket.AF_UNIX) as one:
            one.bind(path.name)
    finally:
        os.chdir(here)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def loop(path: Path) -> None:
    path.symlink_to(path.name)


ODD: dict[str, Callable[[Path], None]] = {
    "a pipe": pipe,
    "a socket": listening,
    "a device": device,
    "a link in a loop": loop,
}
EACH = pytest.mark.parametrize("what", ODD)


@pytest.mark.parametrize(
    ("what", "name"), [*((what, "odd.csv") for what in ODD), ("a pipe", "odd.mcap"), ("a pipe", "odd")]
)
def test_in_a_folder_it_is_left_out_and_said(what: str, name: str, folder: Path, rovid: Rovid) -> None:
    good = rovid("fit-drag", folder, "--json").document
    ODD[what](folder / name)
    said = f"{name} was left out: it is {what}."
    found = rovid("fit-drag", folder, "--json").document
    assert found["parameters"] == good["parameters"]
    assert said in found["warnings"]
    checked = rovid("check", folder, "--json").document
    assert said in str(checked)
    assert len(checked["logs"]) == 5
    guessed = rovid("init", folder, "--force", "--json")
    assert f"{folder / name}: is {what}." in guessed.document["warnings"]


@EACH
def test_in_the_place_of_a_log_it_is_refused(what: str, folder: Path, rovid: Rovid) -> None:
    path = folder / "odd.csv"
    ODD[what](path)
    for command in (["check", path], ["init", path], ["fit-drag", path], ["convert", path, "-o", "new.csv"]):
        assert_one_message(rovid(*command), f"odd.csv: is {what}; a file was expected")
    assert_one_message(rovid("fit-thruster", path), f"odd.csv: is {what}")


@EACH
def test_in_the_place_of_rovids_own_files_it_is_refused(what: str, folder: Path, rovid: Rovid) -> None:
    odd = folder.parent / "odd.toml"
    ODD[what](odd)
    assert_one_message(rovid("simulate", folder, "-p", odd), f"odd.toml: is {what}")
    for name in ("curve.csv", "rovid.toml"):
        (folder / name).unlink()
        ODD[what](folder / name)
        assert_one_message(rovid("check", folder), f"{name}: is {what}")


def test_a_link_to_a_folder_above_is_named(folder: Path, rovid: Rovid) -> None:
    (folder / "deep").mkdir()
    (folder / "deep" / "again").symlink_to(folder)
    checked = rovid("check", folder, "--json").document
    assert "deep/again was left out: it is a link to a folder that it lies in." in str(checked)
    assert len(checked["logs"]) == 5


def test_a_curve_of_a_long_name_is_not_taken_for_the_output(rovid: Rovid, folder: Path) -> None:
    parameters = folder.parent / "parameters.toml"
    assert rovid("fit-drag", folder, "-p", parameters).code == 0
    config = folder / "rovid.toml"
    config.write_text(config.read_text().replace('"curve.csv"', f'"{"c" * 300}.csv"'))
    assert_one_message(rovid("fit-drag", folder, "-p", parameters), "ccc.csv: there is no such")


def test_a_pipe_beside_nmea_text_is_not_its_log(tmp_path: Path, folder: Path, rovid: Rovid) -> None:
    text = (folder / "rovid.toml").read_text()
    (folder / "rovid.toml").write_text(text.replace('heading = { csv = "heading_deg"', 'heading = { nmea = "heading"'))
    (folder / "ins.nmea").write_text(sentence("HEHDT,1.0,T", f"{iso(0.0)} "))
    pipe(folder / "ins.csv")
    assert_one_message(rovid("fit-drag", folder / "ins.nmea"), "no log of its name is in its folder")
