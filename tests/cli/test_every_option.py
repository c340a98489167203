"""Every option of every command: each is used on a small day of logs, and no command ends in an error."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import typer
from typer.core import TyperGroup, TyperOption

from rovid.cli import cli
from tests.conftest import SAMPLES, require_schema, run_rovid, slow

# Command lines in a folder with the logs `day`, the parameter file of a fit, and the files of `prepared`.
LINES = (
    "init bare --vehicle bluerov2 --heading heading_deg --command fore_V,aft_V --axis yaw --force --json",
    "check day --axis yaw --json",
    "convert day/sine.csv -o sine.mcap --axis yaw --force --json",
    "convert day/sine.csv --output sine.csv",
    "fit-drag day --axis yaw --parameters drag.toml --cutoff 0.5 --force --json",
    "fit gyro --gyro -p gyro.toml",
    "fit-thruster bench.csv --output curve.csv --command drive --thrust pull --unit kgf --force --json",
    "fit-thruster table.csv -o table_curve.csv",
    "fit-thrust-scale --before parameters.toml --after heavy.toml --added 500 --reference-error 2 --json",
    "simulate day --force",
    "watch day --once --no-diagnosis --until 'inertia 50 %' -o next.csv --axis yaw -p watch.toml --cutoff 0.5 --json",
    "effect new another_law --force",
    "help thruster_lag --json",
)
# Other tests of `make test` run these with fewer options.
SLOW_LINES = (
    "compare parameters.toml heavy.toml -p parameters.toml --output page.html",
    "simulate day --axis yaw --parameters parameters.toml --cutoff 0.5 --mcap runs --effects-from own_law.py --json",
    "fit-inertia day --axis yaw -p inertia.toml --cutoff 0.5 --force --json",
    "fit day --effect thruster_lag --axis yaw -p lag.toml --cutoff 0.5 --force --effects-from own_law.py --json",
    "control --kp 100 --kd 710 --period 0.2 --delay 0.1 --rate-filter 0.3 --step 350:40 --c l.c --python l.py --json",
    "control day --damping 0.9 --bandwidth 0.3 --law ardusub -p parameters.toml --force --effects-from own_law.py",
    "export gz-sim --output model.sdf --parameters parameters.toml --force --effects-from own_law.py --json",
    "plan --narrow linear_drag --effect thruster_lag --share 0.8 --minutes 4 --max-rate 12 --turns 2 -o run.csv --json",
    "plan day --between thruster_lag --between command_delay --axis yaw --output run.csv --force",
    "plan --design --minutes 4 -p parameters.toml --effects-from own_law.py",
    "plan day --matrix",
    "watch day --once -o next.csv --interval 1 --whole 0 --cut 1 --parameters watch.toml --budget 60 --force",
    "watch day --once --no-diagnosis --output next.csv",
    "diagnose day --axis yaw -p found.toml --cutoff 0.5 --budget 60 --force --effects-from own_law.py --json",
    "diagnose day --parameters found.toml",
    "discover day --write formula.py --plot formula.png --axis yaw --budget 60 --effects-from own_law.py --json",
    "discover day --force",
    "effect try own_law.py day --axis yaw --json",
    "compare day day --axis yaw -o page.html --matters 5 --cutoff 0.5 --budget 600 --force --json",
    "report day --axis yaw -p r.toml -o r --cutoff 0.5 --budget 60 --diagnosis --control --export --force --json",
    "report day --no-diagnosis --no-control --no-export --pdf --journal 84mm --output r --effects-from own_law.py",
    "report --parameters parameters.toml --no-diagnosis",
    "fleet day -o fleet --jobs 1 --timeout 60 --shrink --axis yaw --cutoff 0.5 --force --json",
    "fleet day --output fleet",
)
# The same for the coupled model, on logs of its own.
PLANAR_LINES = (
    "init bare --axes planar --force",
    "check planar --axes planar --json",
    "fit planar --axes planar",
    "diagnose planar --axes planar",
    "simulate planar --axes planar",
    "report planar --axes planar",
    "plan planar --axes planar",
    "compare planar planar --axes planar",
    "export mss --axes planar",
)
# Servers, and options of other machines; tests/app, tests/api and tests/fleet have them.
ELSEWHERE = {"open", "mcp", "fleet --cluster"}


def options() -> Iterator[tuple[str, set[str]]]:
    """Each option as the command line offers it: its command, and its names, which mean the same."""
    group = typer.main.get_command(cli.app)
    assert isinstance(group, TyperGroup)
    for name, command in group.commands.items():
        for option in command.params:
            if isinstance(option, TyperOption):
                yield from ((name, names) for names in (set(option.opts), set(option.secondary_opts)) if names)


def test_every_option_is_used() -> None:
    used = [line.split() for line in LINES + SLOW_LINES + PLANAR_LINES]
    missing = [
        f"{command} {max(names, key=len)}"
        for command, names in options()
        if not any(words[0] == command and names & set(words) for words in used)
    ]
    assert {line for line in missing if not {line, line.split()[0]} & ELSEWHERE} == set()


@pytest.fixture(scope="module")
def prepared(day: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("prepared")
    shutil.copytree(day, folder / "day")
    (folder / "bare").mkdir()
    shutil.copy(day / "sine.csv", folder / "bare")
    write_gyro_log(folder / "day", folder / "gyro")
    bench = pd.DataFrame({"drive": np.linspace(-3, 3, 25)})
    bench["pull"] = bench["drive"] * bench["drive"].abs()
    bench.to_csv(folder / "bench.csv", index=False)
    bench.rename(columns={"drive": "command", "pull": "thrust_N"}).to_csv(folder / "table.csv", index=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert run_rovid("fit", "day").code == 0
        assert run_rovid("effect", "new", "own_law").code == 0
    parameters = (folder / "parameters.toml").read_text()
    inertia = re.search(r"inertia]\nvalue = (.*)", parameters)
    assert inertia is not None
    heavy = f"inertia]\nvalue = {float(inertia[1]) + 500}"
    (folder / "heavy.toml").write_text(parameters.replace(inertia[0], heavy))
    return folder


def write_gyro_log(day: Path, folder: Path) -> None:
    """A log of the day with a yaw rate that has noise of its own."""
    shutil.copytree(day, folder, ignore=shutil.ignore_patterns("holds*"))
    log = pd.read_csv(folder / "sine.csv")
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(log))
    log["rate"] = np.gradient(np.unwrap(log["heading_deg"], period=360), log["time_s"]) + noise
    log.to_csv(folder / "sine.csv", index=False)
    with (folder / "rovid.toml").open("a", encoding="utf-8") as file:
        file.write('yaw_rate = { csv = "rate", unit = "deg/s" }\n')


def run_line(line: str) -> None:
    done = run_rovid(*shlex.split(line))
    assert done.code == 0, done.err
    if "--json" in line:
        for document in done.out.splitlines() if line.startswith("watch") else [done.out]:
            require_schema(json.loads(document))


@pytest.fixture(scope="module")
def planar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("planar")
    shutil.copytree(SAMPLES / "planar_rov", folder / "planar")
    (folder / "bare").mkdir()
    shutil.copy(folder / "planar" / "run_01.csv", folder / "bare")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert run_rovid("fit", "planar", "--axes", "planar").code == 0
    return folder


@pytest.mark.parametrize("line", [*LINES, *map(slow, SLOW_LINES)])
def test_each_line_succeeds(line: str, prepared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(prepared)
    run_line(line)


@pytest.mark.slow
@pytest.mark.parametrize("line", PLANAR_LINES)
def test_each_planar_line_succeeds(line: str, planar: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(planar)
    run_line(line)
