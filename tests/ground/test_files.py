"""Nothing of the user's is replaced, nothing is half written, and no result is lost."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from rovid.campaign.config import find_config
from rovid.ground.errors import ConfigError, OutputError
from rovid.ground.files import Claim, Output
from rovid.ground.files import journal as journal_module
from rovid.ground.files.form import C_SOURCE, CURVE, LOG, PAGE, PARAMETERS, PLAN, RECORDING, Form, export_form, png_form
from rovid.parameters.reading import read_parameters
from tests.conftest import ROOT, run_rovid

SCHEMA = 'schema = "rovid-parameters/1"\n'
FORMS = [PARAMETERS, PAGE, PLAN, CURVE, RECORDING, C_SOURCE, LOG, png_form("plan"), export_form("json")]
POSIX = pytest.mark.skipif(os.name != "posix", reason="modes and signals are POSIX")


def leavings(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob(".*"))


def message(claim: Claim, output: Output, content: str) -> str:
    with pytest.raises(OutputError) as refused:
        claim.write({output: content})
    return str(refused.value)


def saved_in(said: str) -> Path:
    return Path(said.rsplit(" is in ", 1)[1].rstrip("."))


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")


# What stands there


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.words)
def test_a_foreign_file_is_refused_before_the_work(form: Form, tmp_path: Path) -> None:
    path = tmp_path / "mine"
    path.write_text("time,heading\n0,1\n")
    with pytest.raises(OutputError, match=r"is there already .* --force"):
        Claim([Output(path, form)])
    Claim([Output(path, form)], force=True).write({Output(path, form): "new"})
    assert path.read_text() == "new"


def test_another_form_of_output_is_foreign(tmp_path: Path) -> None:
    path = tmp_path / "parameters.toml"
    path.write_text(SCHEMA)
    with pytest.raises(OutputError, match="is not an export"):
        Claim([Output(path, export_form("json"))])
    Claim([Output(path, PARAMETERS)])


@pytest.mark.parametrize(
    ("form", "text"),
    [
        (PLAN, '"time_s","fore","aft"\n0,1,1\n'),  # a spreadsheet that quotes every name
        (PLAN, "time_s,fore,aft\n0,1,1\n"),
        (CURVE, "command,thrust_N\n0,1\n1,2\n"),
        (CURVE, '"command","thrust_N"\n0,1\n1,2\n'),
        (PAGE, '<html>\n<meta name="generator" content="Hugo 0.9">\n'),
        (PARAMETERS, '[notes]\nsaid = "schema = rovid-parameters/1"\n'),
    ],
)
def test_what_others_write_bears_no_mark(form: Form, text: str, tmp_path: Path) -> None:
    (tmp_path / "x").write_text(text)
    assert not form.marks(tmp_path / "x")


def test_what_is_read_is_never_written_over(tmp_path: Path) -> None:
    log = tmp_path / "parameters.toml"
    log.write_text(SCHEMA)
    (tmp_path / "link").symlink_to(log)
    for path in (log, tmp_path / "link"):
        with pytest.raises(OutputError, match="not written over"):
            Claim([Output(path, PARAMETERS)], force=True, protected=[log])


def test_an_empty_file_holds_nothing_to_lose(tmp_path: Path) -> None:
    output = Output(tmp_path / "x", PARAMETERS)
    output.path.touch()
    Claim([output]).write({output: SCHEMA})
    assert output.path.read_text() == SCHEMA


def test_the_same_log_again_is_fine_and_another_is_not(tmp_path: Path) -> None:
    output = Output(tmp_path / "x.csv", LOG)
    output.path.write_text("time_s,a\n0,1\n")
    before = output.path.stat()
    Claim([output], protected=[output.path]).write({output: "time_s,a\n0,1\n"})
    assert output.path.stat() == before
    assert "is there already" in message(Claim([output]), output, "time_s,a\n0,2\n")
    assert leavings(tmp_path) == []
    assert list(Path.cwd().iterdir()) == []


@POSIX
def test_no_folder_pipe_or_device_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "folder", tmp_path / "pipe", Path(os.devnull)):
        with pytest.raises(OutputError, match="a file was expected"):
            Claim([Output(path, PLAN)], force=True)
    assert stat.S_ISCHR(Path(os.devnull).stat().st_mode)


def test_two_outputs_in_one_place_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="two outputs"):
        Claim([Output(tmp_path / "x", PLAN), Output(tmp_path / "y" / ".." / "x", CURVE)])


def test_what_came_to_stand_there_meanwhile_stays(tmp_path: Path) -> None:
    output = Output(tmp_path / "x", PARAMETERS)
    claim = Claim([output])
    output.path.write_text("mine\n")
    saved = saved_in(message(claim, output, SCHEMA))
    assert output.path.read_text() == "mine\n"
    assert saved.read_text() == SCHEMA


# How it is written


@POSIX
def test_modes_and_links_stay(tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text(SCHEMA)
    real.chmod(0o640)
    link.symlink_to("real")
    output = Output(link, PARAMETERS)
    Claim([output]).write({output: SCHEMA + "a = 1\n"})
    assert link.is_symlink()
    assert real.read_text().endswith("a = 1\n")
    assert stat.S_IMODE(real.stat().st_mode) == 0o640


@POSIX
def test_a_link_to_nothing_is_written_through(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("real")
    output = Output(tmp_path / "link", PLAN)
    Claim([output]).write({output: "x"})
    assert (tmp_path / "real").read_text() == "x"
    assert output.path.is_symlink()


@POSIX
def test_a_new_file_goes_by_the_umask(tmp_path: Path) -> None:
    output, old = Output(tmp_path / "x", PLAN), os.umask(0o027)
    try:
        Claim([output]).write({output: "x"})
    finally:
        os.umask(old)
    assert stat.S_IMODE(output.path.stat().st_mode) == 0o640


def test_file_and_folder_are_on_the_disk_before_it_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    real_fsync, real_replace = os.fsync, os.replace

    def fsync(handle: int) -> None:
        said.append("folder" if stat.S_ISDIR(os.fstat(handle).st_mode) else "file")
        real_fsync(handle)

    def replace(source: Path, target: Path) -> None:
        said.append("rename")
        real_replace(source, target)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(os, "replace", replace)
    output = Output(tmp_path / "x", PLAN)
    Claim([output]).write({output: "x"})
    assert said == ["file", "rename", "folder"]


# When it cannot be written


def test_a_claim_leaves_nothing(tmp_path: Path) -> None:
    Claim([Output(tmp_path / "new" / "folder" / "x", PLAN)])
    assert [path.name for path in tmp_path.iterdir()] == ["here"]


def test_a_file_in_place_of_a_folder_is_found_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        Claim([Output(tmp_path / "x" / "y", PLAN)])


def test_a_full_disk_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outputs = [Output(tmp_path / "set" / name, PARAMETERS) for name in ("a", "b/c")]
    claim = Claim(outputs)
    claim.write(dict.fromkeys(outputs, SCHEMA))
    real = journal_module.write_synced

    def full(path: Path, data: bytes) -> None:
        if path.is_relative_to(tmp_path / "set"):
            path.write_bytes(data[:3])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(path, data)

    for module in ("journal", "claim"):
        monkeypatch.setattr(f"rovid.ground.files.{module}.write_synced", full)
    with pytest.raises(OutputError, match="No space left") as refused:
        claim.write({output: f"{SCHEMA}# {output.path.name}\n" for output in outputs})
    saved = saved_in(str(refused.value))
    assert saved.parent == Path.cwd()
    assert {path.name: path.read_text() for path in saved.rglob("*") if path.is_file()} == {
        "a": f"{SCHEMA}# a\n",
        "c": f"{SCHEMA}# c\n",
    }
    assert [output.path.read_text() for output in outputs] == [SCHEMA, SCHEMA]
    assert leavings(tmp_path) == []


def test_where_nothing_can_be_written_that_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output = Output(tmp_path / "x", PLAN)
    claim = Claim([output])

    def full(path: Path, data: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("rovid.ground.files.claim.write_synced", full)
    assert "Nor could it be saved" in message(claim, output, "x")
    assert list(Path.cwd().iterdir()) == []


@contextlib.contextmanager
def public_folder() -> Iterator[Path]:
    """A folder that others may reach, unlike pytest's own."""
    with tempfile.TemporaryDirectory(prefix="rovid-test-") as name:
        Path(name).chmod(0o755)
        yield Path(name)


NOBODY = pytest.mark.skipif(
    shutil.which("setpriv") is None or os.name != "posix" or os.geteuid() != 0,
    reason="needs root, to become somebody who is not, and setpriv",
)
AS_NOBODY = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups")


@NOBODY
def test_a_folder_that_is_not_ours_is_found_before_the_work(tmp_path: Path) -> None:
    code = """
        import sys
        from pathlib import Path
        from rovid.ground.errors import OutputError
        from rovid.ground.files import Claim, Output
        from rovid.ground.files.form import PLAN
        try:
            Claim([Output(Path(sys.argv[1]), PLAN)])
        except OutputError as error:
            print(error)
    """
    with public_folder() as folder:
        folder.chmod(0o755)
        done = run_code(code, folder / "x", before=AS_NOBODY)
    assert "cannot be written (Permission denied)" in done.stdout, done.stderr


# Killed

SET = """
    import os, signal, sys
    from pathlib import Path
    from rovid.ground.files import Claim, Output
    from rovid.ground.files.form import PARAMETERS

    folder, text = Path(sys.argv[1]), sys.argv[2]
    function, at = (sys.argv[3], int(sys.argv[4])) if len(sys.argv) > 3 else ("", 0)
    calls = 0
    real = getattr(os, function, None)

    def counted(*arguments, **options):
        global calls
        calls += 1
        if calls == at:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*arguments, **options)

    if function:
        setattr(os, function, counted)
    outputs = [Output(folder / name, PARAMETERS) for name in ("a", "b", "plots/c", "plots/d")]
    content = 'schema = "rovid-parameters/1"\\n# ' + text + "\\n"
    Claim(outputs).write(dict.fromkeys(outputs, content), stale=[folder / "plots" / "stale"])
"""


def run_code(code: str, *arguments: object, before: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    import filelock

    path = os.pathsep.join([str(ROOT), str(Path(filelock.__file__).parent.parent)])
    return subprocess.run(
        [*before, sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": path},
    )


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


def whole(folder: Path) -> str:
    """The one text that all files of the set hold; stale is there with the old set alone."""
    files = {path.name: path.read_text().split("# ")[1].strip() for path in folder.rglob("[!.]*") if path.is_file()}
    text, *others = set(files.values())
    assert not others, files
    assert sorted(files) == ["a", "b", "c", "d", *(["stale"] if text == "old" else [])]
    return text


@POSIX
@pytest.mark.parametrize("function", ["replace", "fsync", "unlink"])
def test_a_set_killed_at_any_instant_is_the_old_or_the_new(function: str, tmp_path: Path) -> None:
    seen: list[str] = []
    for at in range(1, 40):
        folder = tmp_path / str(at)
        (folder / "plots").mkdir(parents=True)
        for name in ("a", "b", "plots/c", "plots/d", "plots/stale"):
            (folder / name).write_text(f"{SCHEMA}# old\n")
        done = run_code(SET, folder, "new", function, at)
        if done.returncode == 0:
            break
        assert done.returncode == -signal.SIGKILL, done.stderr
        # Other programs look at once, without rovid; it has told whoever waited for all that it says.
        seen.append(whole(folder))
        outputs = [Output(folder / name, PARAMETERS) for name in ("a", "b", "plots/c", "plots/d")]
        Claim(outputs).write(dict.fromkeys(outputs, f"{SCHEMA}# next\n"), stale=[folder / "plots" / "stale"])
        assert whole(folder) == "next"
        assert leavings(folder) == []
    else:
        pytest.fail("it never came to its end")
    assert len(seen) >= 4
    assert "new" in seen
    assert sorted(seen, reverse=True) == seen, "once new it stays so"


@POSIX
def test_without_the_survivor_the_next_rovid_completes_the_set(tmp_path: Path) -> None:
    outputs = [Output(tmp_path / name, PARAMETERS) for name in ("a", "b")]
    Claim(outputs).write(dict.fromkeys(outputs, f"{SCHEMA}# old\n"))
    child = os.fork()
    if child == 0:  # killed with its survivor, at the second rename

        def no_survivor(*_: object, **__: object) -> None:
            raise OSError

        calls: list[Path] = []
        real = os.replace

        def killed(source: Path, target: Path) -> None:
            calls.append(source)
            if len(calls) == 2:
                os.kill(os.getpid(), signal.SIGKILL)
            real(source, target)

        subprocess.Popen = no_survivor  # type: ignore[misc,assignment]  # in the child alone
        os.replace = killed  # type: ignore[assignment]  # as above
        Claim(outputs).write(dict.fromkeys(outputs, f"{SCHEMA}# new\n"))
        os._exit(0)
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL
    assert len({output.path.read_text() for output in outputs}) == 2
    with pytest.raises(ConfigError):  # it looks for rovid.toml, and settles what it finds
        find_config([tmp_path])
    assert {output.path.read_text() for output in outputs} == {f"{SCHEMA}# new\n"}
    assert leavings(tmp_path) == []


@POSIX
def test_an_interrupt_waits_for_the_renames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.replace

    def interrupted(source: Path, target: Path) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        real(source, target)

    monkeypatch.setattr(os, "replace", interrupted)
    outputs = [Output(tmp_path / name, PARAMETERS) for name in ("a", "b")]
    # What is started in the background of a shell ignores interrupts.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            Claim(outputs).write(dict.fromkeys(outputs, SCHEMA))
    finally:
        signal.signal(signal.SIGINT, before)
    assert [output.path.read_text() for output in outputs] == [SCHEMA, SCHEMA]
    assert leavings(tmp_path) == []


# Through the commands


@pytest.fixture(scope="module")
def day(csv_day: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three logs of the day, with parameters of theirs beside the folder."""
    folder = tmp_path_factory.mktemp("outputs")
    (folder / "L").mkdir()
    names = sorted(path.name for path in csv_day.glob("*.csv") if "hold" in path.name)[:6]
    for name in ("rovid.toml", "thrust_curve.csv", *names):
        shutil.copy(csv_day / name, folder / "L")
    for path in csv_day.glob("sine*.csv"):
        shutil.copy(path, folder / "L")
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
        "control -p parameters.toml --c L/hold_02.csv",
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
    assert leavings(tmp_path) == []


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
    assert leavings(mine) == []


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
    from rovid.study import Study

    path = tmp_path / "parameters.toml"
    real = Study.drag

    def meanwhile(self: Study) -> object:
        shutil.copy(day / "parameters.toml", path)
        return real(self)

    monkeypatch.setattr(Study, "drag", meanwhile)
    assert run_rovid("fit-drag", day / "L", "-p", path).code == 0
    assert "inertia" in read_parameters(path).entries


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
    before = (folder / "index.html").stat()
    done = run_rovid(*command)
    assert done.code == 2
    assert "trial_98_mine.png" in done.err
    assert (folder / "index.html").stat() == before
    assert leavings(folder) == []


WITHOUT_WORK = """
    import json, sys
    from rovid.study import Study
    from tests.conftest import run_rovid

    def work(*_, **__):
        sys.exit(77)

    for name in ("drag", "inertia", "likelihood", "diagnosis"):
        setattr(Study, name, work)
    print(json.dumps([vars(run_rovid(*command.split())) for command in sys.argv[1:]]))
"""


@NOBODY
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


# Two at once

UPDATE = """
    import sys
    from dataclasses import replace
    from pathlib import Path
    from rovid.ground.files import Claim
    from rovid.parameters.parameters import Entry, Parameters
    from rovid.parameters.reading import read_parameters
    from rovid.parameters.update import update

    path, name = Path(sys.argv[1]), sys.argv[2]
    before = read_parameters(path) if path.exists() else Parameters(path=path)
    claim = Claim([before.output])
    print("ready", flush=True)
    sys.stdin.readline()
    entry = Entry(value=1.0, standard_error=0.1, unit="", method="")
    for at in range(20):
        key = f"bias_torque.{name}{at}"
        update(before, claim, lambda now: replace(now, entries=dict(now.entries) | {key: entry}))
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
    code = "import sys; from rovid.commands.cli import main; sys.argv[0] = 'rovid'; main()"
    for pair in range(100):
        path = tmp_path / f"{pair}.toml"
        both = [started(code, command, day / "L", "-p", path) for command in ("fit-drag", "fit-inertia")]
        for process in both:
            process.communicate(timeout=600)
            assert process.returncode == 0
        assert {"inertia", "quadratic_drag"} <= set(read_parameters(path).entries)
    assert leavings(tmp_path) == []


# Each writing command, killed at each of its renames

COMMAND = """
    import os, signal, sys
    from pathlib import Path
    from rovid.commands.cli import main

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
        now = content()
        changed = [now.get(path) != old.get(path) for path in new]
        assert now.keys() == (new.keys() if all(changed) else old.keys())
        assert all(changed) or not any(changed)
        following = run_rovid(*command.split())
        assert following.code == 0, following.err
        assert content().keys() == new.keys()
        assert leavings(folder) == []
    assert at == 1 + len(new)


# Any machine


@contextlib.contextmanager
def read_only_install() -> Iterator[tuple[Path, dict[str, str]]]:
    """A package that its user may not write, and the environment of one without a home; an empty temporary folder."""
    import filelock

    with public_folder() as folder:
        shutil.copytree(ROOT / "rovid", folder / "rovid", ignore=shutil.ignore_patterns("__pycache__"))
        temporary = folder / "tmp"
        temporary.mkdir()
        temporary.chmod(0o1777)
        path = os.pathsep.join([str(folder), str(Path(filelock.__file__).parent.parent)])
        keep = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "NUMBA_", "MPL"))}
        yield folder, keep | {"PYTHONPATH": path, "HOME": "/nonexistent", "TMPDIR": str(temporary)}


USE = """
    import rovid.model.kernels
    import rovid.report.plots.canvas
    from rovid.model.kernels import is_compiled, simulate
    import numpy as np
    assert rovid.model.kernels.__file__.startswith({folder!r})
    if {run}:
        simulate(np.arange(3.0), np.zeros(3), 1.0, 1.0, 1.0, 0.0)
    print(is_compiled())
"""


def used(folder: Path, environment: dict[str, str], *, run: bool) -> subprocess.CompletedProcess[str]:
    code = textwrap.dedent(USE.format(folder=str(folder), run=run))
    return subprocess.run(
        [*AS_NOBODY, sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
        cwd=folder,
    )


@NOBODY
def test_without_a_home_a_private_folder_keeps_what_is_compiled() -> None:
    with read_only_install() as (folder, environment):
        first = used(folder, environment, run=True)
        assert first.stdout == "True\n"
        assert first.stderr.count("Note: compiled code and fonts are kept in") == 1
        assert first.stderr.count("\n") == 1
        private = folder / "tmp" / "rovid-cache-65534"
        assert stat.S_IMODE(private.stat().st_mode) == 0o700
        assert used(folder, environment, run=False).stderr == ""


@NOBODY
def test_a_folder_that_somebody_else_made_is_not_trusted() -> None:
    with read_only_install() as (folder, environment):
        planted = folder / "tmp" / "rovid-cache-65534"
        planted.mkdir()
        planted.chmod(0o777)
        done = used(folder, environment | {"MPLCONFIGDIR": str(folder / "tmp")}, run=False)
        assert done.stdout == "False\n"
        assert "cannot be kept anywhere" in done.stderr
        assert done.stderr.count("\n") == 1
        assert list(planted.iterdir()) == []
        assert not (folder / "None").exists()
