"""Every command's output at 60, 80 and 120 columns: no line is longer, no number cut in two or parted from its unit."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rovid.cli.cli import MANUAL
from rovid.control import design
from rovid.export import verification
from rovid.preflight import check
from rovid.present.page import build
from rovid.present.plots import results
from rovid.store import study
from rovid.store.study import Study
from tests.conftest import SAMPLES, Rovid, write_short_day

WIDTHS = (60, 80, 120)
RUNS = ("fore_only", "hold_03", "hold_05", "sine_40s_a")
WIDE = 400
NUMBER = re.compile(r"[-+±]?\d+(?:\.\d+)?(?:e[-+]\d+)?")
PARTED = re.compile(r"\d *\n *(?:%|s|min|deg|rad|N|kg|m|Hz|dB|V)(?=[/ ,.;)²³]|$)", re.MULTILINE)
# In an order in which each finds what it needs.
OF_A_DAY = (
    "check day",
    "fit-drag day",
    "fit-inertia",
    "fit",
    "fit --effect thruster_lag -p lag.toml day",
    "simulate",
    "plan -o next.csv --force",
    "plan --between thruster_lag --between command_delay --force",
    "control",
    "control -p lag.toml",
    "export stonefish --force",
    "export json -p lag.toml --force",
    "diagnose -p diagnosed.toml day",
    "compare lag.toml diagnosed.toml",
)
OF_OTHERS = (
    "init bare --force",
    "init ardusub --force",
    "convert day/hold_03.csv -o hold.csv --force",
    "fit-thruster bench.csv --unit N -o curve.csv --force",
    "check dive",
    "fit-inertia dive -p dive.toml",
    "control dive -p dive.toml",
    "check decays --axis roll",
    "fit decays --axis roll",
    "fit-drag surge --axis surge",
    "fit-drag tables/table3.csv -p tables.toml",
    "fit-inertia tables/sine_trials.csv -p tables.toml",
    "diagnose tables -p tables.toml",
    "fleet bare -o fleet",
    "discover day",
    "effect new own_effect --force",
    "fit-thrust-scale pull/pulls.csv",
    "help",
    "help supply_sag",
    'watch -p watched.toml day --once --until "inertia 2 %" -o next_run.csv',
    "report day -p day.toml --no-diagnosis --no-control --no-export --force",
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, sample in (
        ("dive", "bluerov2_pier59"),
        ("decays", "kvlcc2_roll_decay"),
        ("surge", "surge_tank"),
        ("tables", "rosub_paper"),
        ("ardusub", "ardusub_small"),
    ):
        shutil.copytree(SAMPLES / sample, tmp_path / name)
    shutil.copy(SAMPLES / "thruster_bench" / "kaxan_540.csv", tmp_path / "bench.csv")
    (tmp_path / "pull").mkdir()
    for name in ("rovid.toml", "thrust_curve.csv"):
        shutil.copy(SAMPLES / "rosub_tank" / name, tmp_path / "pull" / name)
    (tmp_path / "pull" / "pulls.csv").write_text("fore,aft,torque_Nm\n4,4,320\n5,5,480\n-4,-4,-310\n")
    write_short_day(tmp_path / "day", runs=RUNS)
    write_short_day(tmp_path / "bare", runs=RUNS, configured=False)
    return tmp_path


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What took long, by name; what is there is not worked out again, for it is the same at any width."""
    kept: dict[str, Any] = {}
    for owner, name in (
        (check, "check_logs"),
        (Study, "diagnosis"),
        (Study, "likelihood"),
        (Study, "plan"),
        (design, "design_controller"),
        (build, "build_report"),
        (verification, "verified_export"),
        (results, "plan_picture"),
        (study, "read_campaign"),
    ):
        monkeypatch.setattr(owner, name, _once(name, getattr(owner, name), kept))
    return kept


def _once(name: str, whole: Callable[..., Any], kept: dict[str, Any]) -> Callable[..., Any]:
    def once(*given: Any, **named: Any) -> Any:
        if name not in kept:
            kept[name] = whole(*given, **named)
        return kept[name]

    return once


def test_every_command_is_looked_at() -> None:
    # Two serve until they are ended: a page, of which they print an address alone, and an assistant.
    assert {command.split()[0] for command in (*OF_A_DAY, *OF_OTHERS)} == set(MANUAL) - {"open", "mcp"}


@pytest.mark.parametrize("commands", [OF_A_DAY, OF_OTHERS], ids=["of a day", "of others"])
@pytest.mark.usefixtures("folder", "blank")
@pytest.mark.slow
def test_output_fits_and_numbers_are_whole(
    commands: tuple[str, ...], rovid: Rovid, slow: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    for command in commands:
        slow.clear()
        printed = {}
        for width in (*WIDTHS, WIDE):
            monkeypatch.setenv("COLUMNS", str(width))
            done = rovid(*shlex.split(command))
            assert (command, done.code, done.err) == (command, 0, "")
            printed[width] = done.out
        for width in WIDTHS:
            longest = max((line.rstrip() for line in printed[width].splitlines()), key=len)
            assert len(longest) <= width, f"{command} at {width}: {longest}"
            broken = set(numbers(printed[width])) - set(numbers(printed[WIDE])) - {str(width)}
            assert not broken, f"{command} at {width}: {broken}\n{printed[width]}"
            assert not (parted := PARTED.findall(printed[width])), f"{command} at {width}: {parted}\n{printed[width]}"
            assert not re.search(r"(?<!\S)-0(\.0+)?(?!\S)", printed[width]), f"{command}: a minus before nothing"


def numbers(text: str) -> list[str]:
    """Words that are numbers, without what stands around them."""
    words = (word.strip("(),.;:%") for word in text.split())
    return [word for word in words if NUMBER.fullmatch(word)]
