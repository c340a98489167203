"""The process of a campaign: its input, and its end with the parent process."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rovid.core.threads import CORES_VARIABLE
from rovid.fleet import campaigns
from rovid.fleet.campaigns import CampaignTask, diagnose_campaign
from tests.conftest import ROOT

TASK = CampaignTask(name="a", folder="/nowhere/a", axis="yaw", cutoff=None, digest="0123")


def test_the_process_gets_its_cores_and_reports_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    code = f"import os, sys; sys.exit(os.environ[{CORES_VARIABLE!r}] + os.environ['OPENBLAS_NUM_THREADS'])"
    monkeypatch.setattr(campaigns, "_CODE", code)
    record = diagnose_campaign(TASK, 60.0, 3)
    assert (record.error, record.failure) == ("its process ended with status 1: 31", "crash")
    assert (record.campaign, record.digest, record.patience) == ("a", "0123", 60.0)


def test_other_output_of_the_process_is_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    noise = "import rovid.fleet.campaigns as a; was = a.campaign_record; "
    noise += "a.campaign_record = lambda t: (print('noise'), was(t))[1]; "
    monkeypatch.setattr(campaigns, "_CODE", noise + campaigns._CODE)  # noqa: SLF001 - what the process runs
    record = diagnose_campaign(TASK, 60.0, 1)
    assert record.failure == "input"
    assert record.error == "a: there is no such file or folder. Give a log or the folder that holds the logs."


def test_the_process_ends_with_its_parent(tmp_path: Path) -> None:
    told = tmp_path / "pid"
    task = json.dumps({"name": "a", "folder": str(tmp_path), "axis": "yaw", "cutoff": None, "digest": ""})
    slow = f"import os, time, rovid.fleet.campaigns as a; open({str(told)!r}, 'w').write(str(os.getpid())); "
    slow += "a.campaign_record = lambda task: time.sleep(600); a.main()"
    code = f"import json, sys, rovid.fleet.campaigns as a; a._CODE = {slow!r}\n"
    code += f"a.diagnose_campaign(a.CampaignTask(**json.loads({task!r})), 600.0, 1)"
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT) as first:
        until(lambda: told.exists() and bool(told.read_text()))
        first.send_signal(signal.SIGKILL)
    number = int(told.read_text())
    until(lambda: not runs(number))


def until(condition: object, patience: float = 30.0) -> None:
    assert callable(condition)
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def runs(number: int) -> bool:
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    # An ended process exists until its status is read.
    state = Path(f"/proc/{number}/stat")
    return not (state.exists() and state.read_text().rpartition(")")[2].split()[0] == "Z")
