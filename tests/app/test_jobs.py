"""A command runs beside the page, says how far it is, and ends with all that it began when it is cancelled."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from rovid.app.jobs import Job, JobQueue
from tests.app.conftest import DAY, logs_into
from tests.conftest import run_rovid


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    logs_into(tmp_path / "day")
    (tmp_path / "day" / "rovid.toml").write_text((DAY / "rovid.toml").read_text())
    return tmp_path


def ended(work: Job) -> Job:
    stop = time.monotonic() + 240.0
    while work.state == "running":
        assert time.monotonic() < stop
        time.sleep(0.05)
    return work


def group(number: int) -> list[int]:
    """Processes of a group that are alive."""
    found = []
    for each in Path("/proc").iterdir():
        if not each.name.isdigit():
            continue
        try:
            fields = (each / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[2]) == number and fields[0] != "Z":
            found.append(int(each.name))
    return found


def test_it_says_step_by_step_what_it_does_and_what_came_out(folder: Path) -> None:
    work = ended(Job(arguments=("report", "day", "--no-diagnosis", "--no-control", "--no-export"), folder=folder))
    document = work.document()
    assert (document["state"], document["error"]) == ("done", "")
    assert [step["text"] for step in document["steps"]] == [
        "Fitting drag and inertia …",
        "Drawing and writing the page …",
    ]
    assert (folder / document["page"]).is_file()


def test_what_fails_says_what_the_command_line_says(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "day" / "hold_03.csv").write_text("time_s,heading_deg,fore_V\n0,1,2\n")
    work = ended(Job(arguments=("report", "day"), folder=folder))
    assert work.state == "failed"
    monkeypatch.chdir(folder)
    assert f"rovid: {work.error}\n" == run_rovid("report", "day").err
    assert "hold_03.csv" in work.error


def test_a_file_called_as_a_module_is_not_run(folder: Path) -> None:
    for name in ("rovid.py", "numpy.py", "json.py"):
        (folder / name).write_text("raise SystemExit(99)\n")
    assert ended(Job(arguments=("check", "day"), folder=folder)).state == "done"


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes are counted by /proc")
def test_cancelled_it_leaves_no_process(folder: Path) -> None:
    work = Job(arguments=("report", "day"), folder=folder)
    number = work.process.pid
    stop = time.monotonic() + 60.0
    while not work.steps and work.state == "running":
        assert time.monotonic() < stop
        time.sleep(0.05)
    assert os.getpgid(number) == number
    work.cancel()
    assert work.state == "cancelled"
    assert work.document()["error"] == ""
    assert group(number) == []
    assert not (folder / "report" / "index.html").exists()


def test_a_new_run_ends_the_one_before(folder: Path) -> None:
    works = JobQueue()
    first = works.start(["report", "day"], folder)
    second = works.start(["check", "day"], folder)
    assert first.state == "cancelled"
    assert ended(second).state == "done"
    works.close()
    assert second.state == "done"
