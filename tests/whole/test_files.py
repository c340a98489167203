"""No command replaces what is the user's, begins work in vain, or loses what another command found."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from rovid.core.transaction import recover
from rovid.store.load import read_parameters
from tests.conftest import ROOT, run_rovid
from tests.core.test_files import AS_NOBODY, NOBODY, POSIX, hidden_files, public_folder, run_code

pytestmark = pytest.mark.usefixtures("here")


def started(code: str, *arguments: object) -> subprocess.Popen[str]:
    import filelock

    path = os.pathsep.join([str(ROOT), str(Path(filelock.__file__).parent.parent)])
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": path},
    )


@pytest.fixture(scope="module")
def day(csv_day: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four logs of the day, with parameters of theirs beside the folder."""
    folder = tmp_path_factory.mktemp("outputs")
    (folder / "L").mkdir()
    for name in (
        "rovid.toml",
        *(f"{name}.csv" for name in ("thrust_curve", "hold_01", "hold_03", "hold_05", "sine_20s")),
    ):
        shutil.copy(csv_day / name, folder / "L")
    done = run_rovid("fit-drag", folder / "L", "-p", folder / "parameters.toml")
    assert done.code == 0, done.err
    done = run_rovid("fit-inertia", "-p", folder / "parameters.toml")
    assert done.code == 0, done.err
    return folder


@pytest.fixture
def mine(day: Path, tmp_path: Path) -> Iterator[Path]:
    """A copy of the day; at the end all that was there is there as it was."""
    folder = tmp_path / "day"
    shutil.copytree(day, folder)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    yield folder
    changed = [path.name for path, content in before.items() if not path.exists() or path.read_bytes() != content]
    assert changed == []


@pytest.mark.parametrize("force", [(), ("--force",)], ids=["plain", "forced"])
@pytest.mark.parametrize(
    "command",
    [
        "convert L/hold_01.csv -o L/hold_03.csv",
        "fit-thruster L/thrust_curve.csv -o L/thrust_curve.csv",
        "export json -p parameters.toml -o L/rovid.toml",
        "export json -p parameters.toml -o L/hold_01.csv",
        "export json -p parameters.toml -o L/thrust_curve.csv",
        "export json -p parameters.toml -o parameters.toml",
        "control -p parameters.toml --c parameters.toml",
        "control -p parameters.toml --c L/hold_05.csv",
        "control -p parameters.toml --python L/rovid.toml",
        "plan -p parameters.toml -o L/hold_01.csv",
        "fit-drag L -p L/hold_01.csv",
        "fit L -p L/rovid.toml",
        "diagnose L -p L/thrust_curve.csv",
        "simulate L/hold_01.csv -p parameters.toml --mcap L/rovid.toml",
    ],
)
def test_no_command_writes_over_the_campaign(
    command: str, force: tuple[str, ...], mine: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(mine)
    done = run_rovid(*command.split(), *force)
    assert done.code == 2, done
    assert "Traceback" not in done.err
    assert done.err.count("\n") == 1
    assert hidden_files(tmp_path) == []


@pytest.mark.slow
def test_a_repeated_command_replaces_what_it_wrote(mine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(mine)
    for command in (
        "convert L/hold_01.csv -o hold.csv",
        "convert L/hold_01.csv -o hold.mcap",
        "convert L/hold_01.csv -o hold.parquet",
        "fit-thruster L/thrust_curve.csv",
        "export json -p parameters.toml",
        "export gz-sim -p parameters.toml",
        "export uuv -p parameters.toml",
        "export uuv -p parameters.toml -o uuv.yaml",
        "export vrx -p parameters.toml",
        "export stonefish -p parameters.toml",
        "export mujoco -p parameters.toml",
        "export ros2 -p parameters.toml",
        "export matlab -p parameters.toml",
        "export python-vehicle-simulator -p parameters.toml",
        "control -p parameters.toml --c c.c --python p.py",
        "simulate L/hold_01.csv -p parameters.toml --mcap simulated.mcap",
    ):
        for _ in range(2):
            done = run_rovid(*command.split())
            assert done.code == 0, (command, done.err)
    assert hidden_files(mine) == []


def test_a_foreign_file_is_kept_unless_forced(mine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(mine)
    (mine / "notes.txt").write_text("mine\n")
    done = run_rovid("export", "json", "-p", "parameters.toml", "-o", "notes.txt")
    assert done.code == 2
    assert "--force" in done.err
    assert (mine / "notes.txt").read_text() == "mine\n"
    assert run_rovid("export", "json", "-p", "parameters.toml", "-o", "notes.txt", "--force").code == 0
    assert json.loads((mine / "notes.txt").read_text())["schema"] == "rovid-model/1"


def test_what_another_wrote_during_a_fit_is_kept(day: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from rovid.store.study import Study

    path = tmp_path / "parameters.toml"
    real = Study.drag

    def meanwhile(self: Study) -> object:
        shutil.copy(day / "parameters.toml", path)
        return real(self)

    monkeypatch.setattr(Study, "drag", meanwhile)
    assert run_rovid("fit-drag", day / "L", "-p", path).code == 0
    assert "inertia" in read_parameters(path).entries


@pytest.mark.usefixtures("blank")
def test_a_report_takes_its_stale_plots_away_and_leaves_the_rest(day: Path, tmp_path: Path) -> None:
    folder = tmp_path / "report"
    parameters = tmp_path / "parameters.toml"
    shutil.copy(day / "parameters.toml", parameters)
    # One log is quickly drawn.
    logs = day / "L" / "hold_01.csv"
    command = ("report", logs, "-p", parameters, "-o", folder, "--no-diagnosis", "--no-control", "--no-export")
    assert run_rovid(*command).code == 0
    plots = folder / "plots"
    next(plots.glob("trial_*.png")).rename(plots / "trial_99_gone.png")
    (plots / "photo.png").write_bytes(b"mine")
    assert run_rovid(*command).code == 0
    assert not (plots / "trial_99_gone.png").exists()
    assert (plots / "photo.png").read_bytes() == b"mine"
    (plots / "trial_98_mine.png").write_bytes(b"mine")
    before = (folder / "index.html").stat().st_mtime_ns
    done = run_rovid(*command)
    assert done.code == 2
    assert "trial_98_mine.png" in done.err
    assert (folder / "index.html").stat().st_mtime_ns == before
    assert hidden_files(folder) == []


WITHOUT_WORK = """
    import json, sys
    from rovid.store.study import Study
    from tests.conftest import run_rovid

    def work(*_, **__):
        sys.exit(77)

    for name in ("drag", "inertia", "likelihood", "diagnosis"):
        setattr(Study, name, work)
    print(json.dumps([vars(run_rovid(*command.split())) for command in sys.argv[1:]]))
"""


@NOBODY
@pytest.mark.slow
def test_where_nothing_can_be_written_no_command_begins_its_work(day: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with public_folder() as public:
        folder, temporary = public / "day", public / "tmp"
        shutil.copytree(day, folder)
        (public / "free.toml").write_bytes((folder / "parameters.toml").read_bytes().replace(b'"L"', b'"day/L"'))
        for place in (folder, folder / "L"):
            place.chmod(0o555)
        for place in (public, temporary):
            place.mkdir(exist_ok=True)
            place.chmod(0o777)
        (public / "free.toml").chmod(0o666)
        monkeypatch.chdir(public)
        monkeypatch.setenv("TMPDIR", str(temporary))  # for caches of nobody's
        commands = [
            "fit-drag day/L -p day/new.toml",
            "fit-inertia day/L -p day/new.toml",
            "fit day/L -p day/new.toml",
            "fit -p day/parameters.toml",
            "diagnose day/L -p day/new.toml",
            "diagnose -p day/parameters.toml",
            "report day/L -p day/new.toml -o page",
            "report -p day/parameters.toml -o page",
            "report -p free.toml -o day/page",
        ]
        free = ["fit -p free.toml", "diagnose -p free.toml", "report -p free.toml -o page"]
        done = run_code(WITHOUT_WORK, *free, *commands, before=AS_NOBODY)
        assert done.returncode == 0, done.stderr
        ends = json.loads(done.stdout)
        assert [end["code"] for end in ends[: len(free)]] == [77, 77, 77], "this is where their work begins"
        for command, said in zip(commands, ends[len(free) :], strict=True):
            assert said["code"] == 2, (command, said)
            assert re.search(r"day/\S+: (cannot be written \(Permission denied\)|is write-protected)", said["err"])
            assert said["err"].count("\n") == 1
            assert said["out"] == ""
        assert not (public / "page").exists()


UPDATE = """
    import sys
    from dataclasses import replace
    from pathlib import Path
    from rovid.core.output_files import OutputSet
    from rovid.store.parameter_file import Entry, Parameters
    from rovid.store.load import read_parameters
    from rovid.store.load import update_parameters

    path, name = Path(sys.argv[1]), sys.argv[2]
    before = read_parameters(path) if path.exists() else Parameters(path=path)
    claim = OutputSet([before.output])
    print("ready", flush=True)
    sys.stdin.readline()
    entry = Entry(value=1.0, standard_error=0.1, unit="", method="")
    for at in range(20):
        key = f"bias_torque.{name}{at}"
        update_parameters(before, claim, lambda now: replace(now, entries=dict(now.entries) | {key: entry}))
"""


def test_no_result_of_two_processes_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "parameters.toml"
    both = [started(UPDATE, path, name) for name in ("a", "b")]
    for process in both:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in both:
        process.communicate("go\n", timeout=120)
        assert process.returncode == 0
    assert len(read_parameters(path).entries) == 40
    assert [item.name for item in tmp_path.iterdir() if item.name != "here"] == ["parameters.toml"]


@pytest.mark.slow
def test_a_hundred_pairs_of_fits_lose_nothing(day: Path, tmp_path: Path) -> None:
    code = "import sys; from rovid.cli.cli import main; sys.argv[0] = 'rovid'; main()"
    for pair in range(100):
        path = tmp_path / f"{pair}.toml"
        both = [started(code, command, day / "L", "-p", path) for command in ("fit-drag", "fit-inertia")]
        for process in both:
            process.communicate(timeout=600)
            assert process.returncode == 0
        assert {"inertia", "quadratic_drag"} <= set(read_parameters(path).entries)
    assert hidden_files(tmp_path) == []


COMMAND = """
    import os, signal, sys
    from pathlib import Path
    from rovid.cli.cli import main

    at, calls, real = int(sys.argv[1]), 0, os.replace

    def counted(source, target):
        global calls
        calls += Path(source).name.startswith(".rovid-")
        if calls == at:
            os.kill(os.getpid(), signal.SIGKILL)
        real(source, target)

    os.replace = counted
    sys.argv = ["rovid", *sys.argv[2:]]
    main()
"""


@POSIX
@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "outputs"),
    [
        ("fit-drag L -p parameters.toml", ["parameters.toml"]),
        ("fit-inertia L -p parameters.toml", ["parameters.toml"]),
        ("fit L -p parameters.toml", ["parameters.toml"]),
        ("diagnose L -p parameters.toml", ["parameters.toml"]),
        ("convert L/hold_01.csv -o log.csv", ["log.csv"]),
        ("convert L/hold_01.csv -o log.mcap", ["log.mcap"]),
        ("convert L/hold_01.csv -o log.parquet", ["log.parquet"]),
        ("fit-thruster L/thrust_curve.csv -o curve.csv", ["curve.csv"]),
        ("export json -p parameters.toml", ["rovid.json"]),
        ("control -p parameters.toml --c c.c --python p.py", ["c.c", "p.py"]),
        ("plan -p parameters.toml", ["plan.csv", "plan.png"]),
        ("simulate -p parameters.toml --mcap out", ["out"]),
        ("init L --force", ["L/rovid.toml", "L/thrust_guess.csv"]),
        ("report -p parameters.toml --no-diagnosis --no-control --no-export", ["report"]),
    ],
)
def test_a_command_killed_at_each_rename(
    command: str, outputs: list[str], day: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "day"
    shutil.copytree(day, folder)
    monkeypatch.chdir(folder)
    if command.startswith("init"):
        (folder / "L" / "thrust_curve.csv").unlink()

    def content() -> dict[Path, bytes]:
        places = [folder / name for name in outputs]
        files = [file for place in places for file in ([place] if place.is_file() else place.rglob("[!.]*"))]
        return {file: file.read_bytes() for file in files if file.is_file()}

    first = run_rovid(*command.split())
    assert first.code == 0, first.err
    # With its mark, and unlike what will be written; what is converted is a log, which is never replaced.
    replaced = not command.startswith("convert")
    new = content()
    old = {path: text + b"\n" for path, text in new.items()} if replaced else {}
    at = 0
    while True:
        at += 1
        for path in new.keys() - old.keys():
            path.unlink(missing_ok=True)
        for path, text in old.items():
            path.write_bytes(text)
        done = run_code(COMMAND, at, *command.split())
        if done.returncode == 0:
            break
        assert done.returncode == -signal.SIGKILL, done.stderr
        # The next rovid that comes to a folder of the set completes it or undoes it.
        for place in {path.parent for path in new}:
            if place.is_dir():
                recover(place)
        now = content()
        changed = [now.get(path) != old.get(path) for path in new]
        assert now.keys() == (new.keys() if all(changed) else old.keys())
        assert all(changed) or not any(changed)
        following = run_rovid(*command.split())
        assert following.code == 0, following.err
        assert content().keys() == new.keys()
        assert hidden_files(folder) == []
    assert at == 1 + len(new)
