"""Jobs of the page: progress, result, and cancellation with all child processes."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from rovid.app.jobs import Job, JobQueue, add_step, counted
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
    """Living processes of a group."""
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


def test_a_job_reports_steps_and_result(folder: Path) -> None:
    work = ended(Job(arguments=("report", "day", "--no-diagnosis", "--no-control", "--no-export"), folder=folder))
    document = work.document()
    assert (document["state"], document["error"]) == ("done", "")
    # On a busy machine the reading is counted.
    assert [step["text"].partition(":")[0].removesuffix(" …") + " …" for step in document["steps"]] == [
        "Reading the logs …",
        "Fitting drag and inertia …",
        "Drawing and writing the page …",
    ]
    assert (folder / document["page"]).is_file()


def test_a_step_that_counts_on_is_one_step() -> None:
    steps: list[tuple[float, str]] = []
    said = ("Model with no effect: score tests …", "Model with no effect: cause 3 of 9, about 5 s …")
    for after, text in enumerate((*said, "Model with no effect: cause 5 of 9, about 3 s …", "Testing for waves …")):
        add_step(steps, float(after), text)
    assert counted(steps[0][1]) == {"done": 4, "total": 9}
    assert counted(steps[1][1]) == {}
    assert steps == [(0.0, "Model with no effect: cause 5 of 9, about 3 s …"), (3.0, "Testing for waves …")]


def test_a_failed_job_has_the_message_of_the_command_line(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "day" / "hold_03.csv").write_text("time_s,heading_deg,fore_V\n0,1,2\n")
    work = ended(Job(arguments=("report", "day"), folder=folder))
    assert work.state == "failed"
    monkeypatch.chdir(folder)
    assert f"rovid: {work.error}\n" == run_rovid("report", "day").err
    assert "hold_03.csv" in work.error


def test_a_file_named_like_a_module_is_not_imported(folder: Path) -> None:
    for name in ("rovid.py", "numpy.py", "json.py"):
        (folder / name).write_text("raise SystemExit(99)\n")
    assert ended(Job(arguments=("check", "day"), folder=folder)).state == "done"


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes are counted by /proc")
def test_a_cancelled_job_leaves_no_process(folder: Path) -> None:
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


def test_a_new_job_cancels_the_previous_one(folder: Path) -> None:
    works = JobQueue()
    first = works.start(["report", "day"], folder)
    second = works.start(["check", "day"], folder)
    assert first.state == "cancelled"
    assert ended(second).state == "done"
    works.close()
    assert second.state == "done"
