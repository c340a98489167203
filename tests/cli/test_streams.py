"""Odd surroundings: closed and full outputs, other encodings, impossible settings, a working folder that is gone."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rovid.cli.cli import main
from rovid.cli.streams import machine_error, prepare_streams
from tests.conftest import SAMPLES, Rovid

TABLES = SAMPLES / "rosub_paper"
# Each row: redirections, and additions to the environment; status, and the end of standard error.
SURROUNDINGS: dict[str, tuple[str, dict[str, str], int, str]] = {
    "closed error output": ("2>&-", {}, 0, ""),
    "closed output": (">&-", {}, 0, ""),
    "full device": (">/dev/full", {}, 2, "the output cannot be written: No space left on device. Free some space"),
    "no columns": ("", {"COLUMNS": "0"}, 0, ""),
    "ASCII": ("", {"PYTHONIOENCODING": "ascii"}, 0, ""),
    "no number of cores": ("", {"ROVID_CORES": "abc"}, 2, "ROVID_CORES: is 'abc'; a whole number of cores"),
    "working folder deleted": ("", {"GONE": "1"}, 2, "the working folder does not exist any more."),
}


@pytest.mark.skipif(sys.platform == "win32", reason="a POSIX shell")
@pytest.mark.parametrize("name", SURROUNDINGS)
def test_odd_surroundings_give_a_result_or_one_message(name: str, tmp_path: Path) -> None:
    redirection, extra, status, words = SURROUNDINGS[name]
    leave = "rmdir ../gone;" if "GONE" in extra else ""
    (tmp_path / "gone").mkdir()
    command = f'{leave} "{sys.executable}" -m rovid fit-drag "{TABLES}" -p p.toml {redirection}'
    done = subprocess.run(
        ["sh", "-c", command],
        cwd=tmp_path / "gone",
        env=os.environ | extra,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    assert words in done.stderr
    assert done.stderr.count("\n") == (status == 2)
    if not redirection and not status:
        assert "quadratic_drag" in done.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="a POSIX pipe")
@pytest.mark.parametrize("arguments", [("help", "files"), ("help", "--json")])
def test_a_reader_that_ends_is_no_error(arguments: tuple[str, ...]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "rovid", *arguments]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")


def test_ascii_spells_what_it_lacks(tmp_path: Path) -> None:
    code = "from rovid.cli.streams import prepare_streams; prepare_streams(); print('1 ± 2 N m², τ ≥ √2 …')"
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "1 +- 2 N m2, tau >= sqrt 2 ...\n"


def test_an_impossible_width_is_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    for width, kept in (("0", None), ("-3", None), ("wide", None), ("88", "88")):
        monkeypatch.setenv("COLUMNS", width)
        prepare_streams()
        assert os.environ.get("COLUMNS") == kept


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        OSError(errno.ENOMEM, os.strerror(errno.ENOMEM), "a.csv"),
        ImportError("_sparsetools.so: failed to map segment from shared object"),
        RuntimeError("can't start new thread"),
    ],
)
def test_too_little_memory_is_one_message(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(**_: object) -> None:
        raise error

    monkeypatch.setattr("rovid.cli.cli._command", lambda: fails)
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert capsys.readouterr().err.startswith("rovid: there is not enough memory.")


@pytest.mark.skipif(sys.platform != "linux", reason="a limit of the address space")
def test_a_limit_that_is_too_low_for_a_diagnosis_is_one_message(tmp_path: Path) -> None:
    """With 800 MB the compiler of the kernels would end the process, or wait for ever."""
    command = f'ulimit -v 800000; "{sys.executable}" -m rovid diagnose "{SAMPLES / "rosub_hidden"}" -p p.toml'
    done = subprocess.run(["sh", "-c", command], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("rovid: there is not enough memory. rovid needs about 1 GB")
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "p.toml").exists()


def test_other_errors_are_not_taken_for_a_lack_of_memory() -> None:
    for error in (OSError(1, "of another kind"), ImportError("No module named 'x'"), RuntimeError("a fault of rovid")):
        assert not machine_error(error)


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux alone")
def test_a_folder_whose_name_is_no_text_is_found_again(tmp_path: Path, rovid: Rovid) -> None:
    folder = tmp_path / os.fsdecode(b"fo\xffld")
    shutil.copytree(TABLES, folder)
    assert rovid("fit-drag", folder, "-p", folder / "p.toml").code == 0
    again = rovid("fit-inertia", "-p", folder / "p.toml", "--json")
    assert again.code == 0, again.err
