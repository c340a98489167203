"""Output files: no file of the user is replaced, no set is left half written, and no result is lost."""

from __future__ import annotations

import contextlib
import errno
import os
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

from rovid.core import transaction
from rovid.core.errors import ConfigError, OutputError
from rovid.core.output_files import (
    C_SOURCE,
    CURVE,
    LOG,
    PAGE,
    PARAMETERS,
    PLAN,
    RECORDING,
    FileSignature,
    OutputFile,
    OutputSet,
    export_signature,
    png_signature,
)
from rovid.core.transaction import recover
from rovid.trial.config import find_config
from tests.conftest import ROOT

pytestmark = pytest.mark.usefixtures("here")
SCHEMA = 'schema = "rovid-parameters/1"\n'
FORMS = [PARAMETERS, PAGE, PLAN, CURVE, RECORDING, C_SOURCE, LOG, png_signature("plan"), export_signature("json")]
POSIX = pytest.mark.skipif(os.name != "posix", reason="modes and signals are POSIX")


def hidden_files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob(".*"))


def message(output_set: OutputSet, output: OutputFile, content: str) -> str:
    with pytest.raises(OutputError) as refused:
        output_set.write({output: content})
    return str(refused.value)


def saved_in(text: str) -> Path:
    return Path(text.rsplit(" saved in ", 1)[1].rstrip("."))


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.description)
def test_a_foreign_file_is_refused_before_the_work(form: FileSignature, tmp_path: Path) -> None:
    path = tmp_path / "mine"
    path.write_text("time,heading\n0,1\n")
    with pytest.raises(OutputError, match=r"already exists, .* --force"):
        OutputSet([OutputFile(path, form)])
    OutputSet([OutputFile(path, form)], force=True).write({OutputFile(path, form): "new"})
    assert path.read_text() == "new"


def test_another_form_of_output_is_foreign(tmp_path: Path) -> None:
    path = tmp_path / "parameters.toml"
    path.write_text(SCHEMA)
    with pytest.raises(OutputError, match="is not an export"):
        OutputSet([OutputFile(path, export_signature("json"))])
    OutputSet([OutputFile(path, PARAMETERS)])


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
def test_files_of_other_programs_do_not_match(form: FileSignature, text: str, tmp_path: Path) -> None:
    (tmp_path / "x").write_text(text)
    assert not form.matches(tmp_path / "x")


def test_an_input_is_never_replaced(tmp_path: Path) -> None:
    log = tmp_path / "parameters.toml"
    log.write_text(SCHEMA)
    (tmp_path / "link").symlink_to(log)
    for path in (log, tmp_path / "link"):
        with pytest.raises(OutputError, match="never replaced"):
            OutputSet([OutputFile(path, PARAMETERS)], force=True, protected=[log])


def test_an_empty_file_may_be_replaced(tmp_path: Path) -> None:
    output = OutputFile(tmp_path / "x", PARAMETERS)
    output.path.touch()
    OutputSet([output]).write({output: SCHEMA})
    assert output.path.read_text() == SCHEMA


def test_the_same_log_again_is_fine_and_another_is_not(tmp_path: Path) -> None:
    output = OutputFile(tmp_path / "x.csv", LOG)
    output.path.write_text("time_s,a\n0,1\n")
    before = output.path.stat()
    OutputSet([output], protected=[output.path]).write({output: "time_s,a\n0,1\n"})
    after = output.path.stat()  # Reading the file may change the time of the last access.
    assert (after.st_ino, after.st_mtime_ns, after.st_ctime_ns) == (
        before.st_ino,
        before.st_mtime_ns,
        before.st_ctime_ns,
    )
    said = message(OutputSet([output]), output, "time_s,a\n0,2\n")
    assert "already exists, and may hold your changes. Give --force" in said
    assert hidden_files(tmp_path) == []
    assert list(Path.cwd().iterdir()) == []


@POSIX
def test_no_folder_pipe_or_device_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "folder", tmp_path / "pipe", Path(os.devnull)):
        with pytest.raises(OutputError, match="a file was expected"):
            OutputSet([OutputFile(path, PLAN)], force=True)
    assert stat.S_ISCHR(Path(os.devnull).stat().st_mode)


def test_two_outputs_in_one_place_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="two outputs"):
        OutputSet([OutputFile(tmp_path / "x", PLAN), OutputFile(tmp_path / "y" / ".." / "x", CURVE)])


def test_a_file_written_meanwhile_stays(tmp_path: Path) -> None:
    output = OutputFile(tmp_path / "x", PARAMETERS)
    output_set = OutputSet([output])
    output.path.write_text("mine\n")
    saved = saved_in(message(output_set, output, SCHEMA))
    assert output.path.read_text() == "mine\n"
    assert saved.read_text() == SCHEMA


@POSIX
def test_modes_and_links_stay(tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text(SCHEMA)
    real.chmod(0o640)
    link.symlink_to("real")
    output = OutputFile(link, PARAMETERS)
    OutputSet([output]).write({output: SCHEMA + "a = 1\n"})
    assert link.is_symlink()
    assert real.read_text().endswith("a = 1\n")
    assert stat.S_IMODE(real.stat().st_mode) == 0o640


@POSIX
def test_a_link_to_nothing_is_written_through(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("real")
    output = OutputFile(tmp_path / "link", PLAN)
    OutputSet([output]).write({output: "x"})
    assert (tmp_path / "real").read_text() == "x"
    assert output.path.is_symlink()


@POSIX
def test_a_new_file_goes_by_the_umask(tmp_path: Path) -> None:
    output, old = OutputFile(tmp_path / "x", PLAN), os.umask(0o027)
    try:
        OutputSet([output]).write({output: "x"})
    finally:
        os.umask(old)
    assert stat.S_IMODE(output.path.stat().st_mode) == 0o640


def test_file_and_folder_are_on_the_disk_before_it_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text: list[str] = []
    real_fsync, real_replace = os.fsync, os.replace

    def fsync(handle: int) -> None:
        text.append("folder" if stat.S_ISDIR(os.fstat(handle).st_mode) else "file")
        real_fsync(handle)

    def replace(source: Path, target: Path) -> None:
        text.append("rename")
        real_replace(source, target)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(os, "replace", replace)
    output = OutputFile(tmp_path / "x", PLAN)
    OutputSet([output]).write({output: "x"})
    assert text == ["file", "rename", "folder"]


def test_the_check_before_the_work_leaves_nothing(tmp_path: Path) -> None:
    OutputSet([OutputFile(tmp_path / "new" / "folder" / "x", PLAN)])
    assert [path.name for path in tmp_path.iterdir()] == ["here"]


def test_a_file_in_place_of_a_folder_is_found_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        OutputSet([OutputFile(tmp_path / "x" / "y", PLAN)])


def test_a_full_disk_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outputs = [OutputFile(tmp_path / "set" / name, PARAMETERS) for name in ("a", "b/c")]
    output_set = OutputSet(outputs)
    output_set.write(dict.fromkeys(outputs, SCHEMA))
    real = transaction.write_synced

    def full(path: Path, data: bytes) -> None:
        if path.is_relative_to(tmp_path / "set"):
            path.write_bytes(data[:3])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(path, data)

    for module in ("transaction", "output_files"):
        monkeypatch.setattr(f"rovid.core.{module}.write_synced", full)
    with pytest.raises(OutputError, match="No space left") as refused:
        output_set.write({output: f"{SCHEMA}# {output.path.name}\n" for output in outputs})
    saved = saved_in(str(refused.value))
    assert saved.parent == Path.cwd()
    assert {path.name: path.read_text() for path in saved.rglob("*") if path.is_file()} == {
        "a": f"{SCHEMA}# a\n",
        "c": f"{SCHEMA}# c\n",
    }
    assert [output.path.read_text() for output in outputs] == [SCHEMA, SCHEMA]
    assert hidden_files(tmp_path) == []


def test_the_message_where_nothing_can_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output = OutputFile(tmp_path / "x", PLAN)
    output_set = OutputSet([output])

    def full(path: Path, data: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for module in ("transaction", "output_files"):
        monkeypatch.setattr(f"rovid.core.{module}.write_synced", full)
    assert "could not be saved anywhere else" in message(output_set, output, "x")
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
        from rovid.core.errors import OutputError
        from rovid.core.output_files import OutputFile, OutputSet
        from rovid.core.output_files import PLAN
        try:
            OutputSet([OutputFile(Path(sys.argv[1]), PLAN)])
        except OutputError as error:
            print(error)
    """
    with public_folder() as folder:
        folder.chmod(0o755)
        done = run_code(code, folder / "x", before=AS_NOBODY)
    assert "cannot be written (Permission denied)" in done.stdout, done.stderr


SET = """
    import os, signal, sys
    from pathlib import Path
    from rovid.core.output_files import OutputFile, OutputSet
    from rovid.core.output_files import PARAMETERS

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
    outputs = [OutputFile(folder / name, PARAMETERS) for name in ("a", "b", "plots/c", "plots/d")]
    content = 'schema = "rovid-parameters/1"\\n# ' + text + "\\n"
    OutputSet(outputs).write(dict.fromkeys(outputs, content), stale=[folder / "plots" / "stale"])
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
        # The next rovid that comes to one folder of the set completes it or undoes it.
        recover(folder)
        seen.append(whole(folder))
        outputs = [OutputFile(folder / name, PARAMETERS) for name in ("a", "b", "plots/c", "plots/d")]
        OutputSet(outputs).write(dict.fromkeys(outputs, f"{SCHEMA}# next\n"), stale=[folder / "plots" / "stale"])
        assert whole(folder) == "next"
        assert hidden_files(folder) == []
    else:
        pytest.fail("it never came to its end")
    assert len(seen) >= 4
    assert "new" in seen
    assert sorted(seen, reverse=True) == seen, "once new it stays so"


@POSIX
def test_a_set_killed_between_two_renames_is_completed_by_the_next_command(tmp_path: Path) -> None:
    outputs = [OutputFile(tmp_path / name, PARAMETERS) for name in ("a", "b")]
    OutputSet(outputs).write(dict.fromkeys(outputs, f"{SCHEMA}# old\n"))
    child = os.fork()
    if child == 0:  # is killed at the second rename
        calls: list[Path] = []
        real = os.replace

        def killed(source: Path, target: Path) -> None:
            calls.append(source)
            if len(calls) == 2:
                os.kill(os.getpid(), signal.SIGKILL)
            real(source, target)

        os.replace = killed  # type: ignore[assignment]  # in the child alone
        OutputSet(outputs).write(dict.fromkeys(outputs, f"{SCHEMA}# new\n"))
        os._exit(0)
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL
    assert len({output.path.read_text() for output in outputs}) == 2
    with pytest.raises(ConfigError):  # every command looks for rovid.toml, and recovers interrupted sets there
        find_config([tmp_path])
    assert {output.path.read_text() for output in outputs} == {f"{SCHEMA}# new\n"}
    assert hidden_files(tmp_path) == []


@POSIX
def test_an_interrupted_set_is_completed_by_the_next_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.replace

    def interrupted(source: Path, target: Path) -> None:
        real(source, target)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(os, "replace", interrupted)
    outputs = [OutputFile(tmp_path / name, PARAMETERS) for name in ("a", "b")]
    # What is started in the background of a shell ignores interrupts.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            OutputSet(outputs).write(dict.fromkeys(outputs, SCHEMA))
    finally:
        signal.signal(signal.SIGINT, before)
    assert sorted(output.path.exists() for output in outputs) == [False, True]
    monkeypatch.undo()
    recover(tmp_path)
    assert [output.path.read_text() for output in outputs] == [SCHEMA, SCHEMA]
    assert hidden_files(tmp_path) == []
