"""Shell completion, by the protocol between typer and the shells."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from rovid.cli import options
from rovid.cli.cli import MANUAL
from rovid.effects import CATALOGUE
from rovid.estimate.thrust_curve import THRUST_UNITS
from rovid.export import FORMATS
from rovid.model.parameter_names import base_names
from rovid.trial.axis import AXES, YAW
from tests.conftest import run_rovid
from tests.test_house import HEAVY

Offered = Callable[..., list[str]]
EFFECTS = sorted(effect.id for effect in CATALOGUE)
BIN = Path(sys.executable).parent
NEEDS_BASH = pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")


@pytest.fixture
def offered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Offered:
    """Completions that bash gets for the last of the words, in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def ask(*words: str) -> list[str]:
        monkeypatch.setenv("COLUMNS", "80")  # which completion changes
        monkeypatch.setenv("_ROVID_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", " ".join(["rovid", *words]))
        monkeypatch.setenv("COMP_CWORD", str(len(words)))
        done = run_rovid()
        assert (done.code, done.err) == (0, "")
        return done.out.split()

    return ask


def test_commands_and_options(offered: Offered) -> None:
    assert offered("") == list(MANUAL)
    assert offered("fit-") == ["fit-drag", "fit-inertia", "fit-thruster", "fit-thrust-scale"]
    assert {"--effect", "--axis", "--parameters", "--json"} <= set(offered("fit", "--"))
    assert offered("report", "--no-d") == ["--no-diagnosis"]


@pytest.mark.parametrize(
    ("words", "values"),
    [
        (["fit", "--effect", ""], EFFECTS),
        (["fit", "some_logs", "--effect", "thruster_lag", "--effect", ""], EFFECTS),
        (["plan", "--between", ""], EFFECTS),
        (["plan", "--between", "thruster_lag", "--between", "command_d"], ["command_delay"]),
        *(([name, "--axis", ""], list(AXES)) for name in MANUAL if "--axis AXIS" in run_rovid(name, "--help").out),
        (["fit", "--axis", "s"], ["surge", "sway"]),
        (["export", ""], list(FORMATS)),
        (["help", "thruster_l"], ["thruster_lag"]),
        (["help", "l"], ["logs", "lost_rows"]),
        (["export", "m"], ["mujoco", "matlab", "mss"]),
        (["fit-thruster", "--unit", ""], list(THRUST_UNITS)),
        (["plan", "--narrow", ""], list(base_names(YAW))),
    ],
)
def test_completed_values_are_those_the_command_accepts(words: list[str], values: list[str], offered: Offered) -> None:
    assert offered(*words) == values


def test_narrow_offers_what_the_parameter_file_holds(offered: Offered, tmp_path: Path) -> None:
    for name, parameter in (("parameters", "a"), ("parameters_surge", "b"), ("other", "thruster_lag.time_constant")):
        (tmp_path / f"{name}.toml").write_text(f'[parameters."{parameter}"]\nvalue = 1.0\n')
    (tmp_path / "broken.toml").write_text("[parameters")
    assert offered("plan", "--narrow", "") == ["a"]
    assert offered("plan", "--axis", "surge", "--narrow", "") == ["b"]
    assert offered("plan", "-p", "other.toml", "--narrow", "thr") == ["thruster_lag.time_constant"]
    assert offered("plan", "-p", "broken.toml", "--narrow", "") == list(options.BASE)


@pytest.mark.parametrize(
    "words",
    [
        ["fit-drag", "sam"],
        ["report", "first.csv", ""],
        ["convert", ""],
        ["fit-thruster", ""],
        ["fit", "-p", ""],
        ["export", "gz-sim", "-o", ""],
        ["simulate", "--mcap", ""],
    ],
)
def test_files_and_folders_are_left_to_the_shell(words: list[str], offered: Offered) -> None:
    assert offered(*words) == []


def test_zsh_and_fish_get_one_line_a_value(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("_TYPER_COMPLETE_ARGS", "rovid fit --")
    monkeypatch.setenv("_TYPER_COMPLETE_FISH_ACTION", "get-args")
    for shell, lead in (("zsh", '"--'), ("fish", "--")):
        monkeypatch.setenv("_ROVID_COMPLETE", f"complete_{shell}")
        lines = run_rovid().out.removeprefix("_arguments '*: :((").splitlines()
        assert len(lines) > 5
        assert all(line.startswith(lead) for line in lines)


def test_completion_imports_nothing_heavy() -> None:
    code = (
        "import atexit, sys\nfrom rovid.cli.cli import main\nsys.argv = ['rovid']\n"
        f"atexit.register(lambda: print([m for m in {HEAVY!r} if m in sys.modules]))\nmain()"
    )
    words = {"_ROVID_COMPLETE": "complete_bash", "COMP_WORDS": "rovid fit --effect wave", "COMP_CWORD": "3"}
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **words}, capture_output=True, text=True, check=True
    )
    assert done.stdout.split("\n") == ["wave_torque", "[]", ""]


@NEEDS_BASH
def test_bash_installs_and_completes(tmp_path: Path) -> None:
    script = """
        rovid --install-completion > installed
        source .bashrc
        complete -p rovid
        COMP_WORDS=(rovid fit --effect thruster_l) COMP_CWORD=3
        _rovid_completion rovid
        echo "${COMPREPLY[@]}"
    """
    rovid = tmp_path / "rovid"
    rovid.write_text(f"#!{sys.executable}\nfrom rovid.cli.cli import main\nmain()\n")
    rovid.chmod(0o755)
    done = subprocess.run(
        ["bash", "--norc", "-euc", script],
        cwd=tmp_path,
        env={"HOME": str(tmp_path), "PATH": f"{tmp_path}{os.pathsep}{BIN}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,  # the assertion below shows what it said
    )
    assert (done.stderr, done.returncode) == ("", 0)
    # -o default: where nothing is offered, bash completes the names of files and folders.
    assert done.stdout.splitlines() == ["complete -o default -F _rovid_completion rovid", "thruster_lag"]
