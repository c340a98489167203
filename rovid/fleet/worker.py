"""One campaign in a process of its own: whatever becomes of that, the others go on, and its memory is given back."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import IO, Any

from rovid.core.errors import RovidError
from rovid.core.threads import CORES_VARIABLE
from rovid.fleet.campaign_record import CampaignRecord, CampaignTask

# Settled first: most of what it ever makes is made by importing.
_CODE = "from rovid.core.process_tuning import tune_process; tune_process(); from rovid.fleet.worker import main; main()"


def diagnose_campaign(task: CampaignTask, patience: float, cores: int) -> CampaignRecord:
    """What comes of ``task`` in a process that has ``patience`` s and so many ``cores``; never raises for the task."""
    began = time.monotonic()
    command = [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {_CODE}", json.dumps(asdict(task))]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", CORES_VARIABLE: str(cores)}
    with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as complaint:
        # It ends when its input does, so that it does not outlive this process either.
        with subprocess.Popen(  # noqa: S603 - Python itself
            command,
            stdin=subprocess.PIPE,
            stdout=said,
            stderr=complaint,
            env=environment,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        ) as process:
            try:
                status = process.wait(patience)
            except subprocess.TimeoutExpired:
                process.kill()
                text = f"no diagnosis within {patience:g} s; --timeout gives it longer."
                return _failed(task, text, "timeout", patience, time.monotonic() - began)
            except BaseException:
                process.kill()
                raise
        took = time.monotonic() - began
        if status:
            return _failed(task, _crash(status, _read(complaint).decode("utf-8", "replace")), "crash", patience, took)
        return replace(CampaignRecord(**_document(_read(said))), took=round(took, 3), patience=patience)


def _read(file: IO[bytes]) -> bytes:
    file.seek(0)
    return file.read()


def _document(text: bytes) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(text)
    del document["schema"]
    return document


def _failed(task: CampaignTask, error: str, failure: str, patience: float, took: float) -> CampaignRecord:
    return CampaignRecord(
        campaign=task.name,
        folder=task.folder,
        digest=task.digest,
        error=error,
        failure=failure,
        patience=patience,
        took=round(took, 3),
    )


def _crash(status: int, complaint: str) -> str:
    """How its process ended, in a sentence."""
    lines = complaint.strip().splitlines()
    last = f": {lines[-1].strip()}" if lines else ""
    if status < 0:
        return f"its process was ended by {_signal(-status)}{last}."
    return f"its process ended with status {status}{last}"


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def main() -> None:
    """As that process: diagnose the campaign of the first argument, and print the record."""
    out, sys.stdout = sys.stdout, sys.stderr
    threading.Thread(target=_end_with_the_first, daemon=True).start()
    record = campaign_record(CampaignTask(**json.loads(sys.argv[1])))
    out.write(record.text)
    out.flush()
    # Threads that wait, and second processes, are of no use any more.
    os._exit(0)


def _end_with_the_first() -> None:
    # Nothing is ever written there.
    sys.stdin.read()
    os._exit(1)


def campaign_record(task: CampaignTask) -> CampaignRecord:
    """The campaign's diagnosis, or what its user has to mend."""
    folder = Path(task.folder)
    try:
        facts = _diagnosis(folder, task)
    except RovidError as error:
        # As seen from the campaign: the same wherever the fleet lies.
        text = str(error).replace(f"{folder}{os.sep}", "").replace(str(folder), task.name)
        facts = {"error": text, "failure": "input"}
    peak = _peak_memory()
    return CampaignRecord(campaign=task.name, folder=task.folder, digest=task.digest, peak_memory=peak, **facts)


def _diagnosis(folder: Path, task: CampaignTask) -> Mapping[str, Any]:
    from rovid.present.documents.diagnosis import diagnosis_document
    from rovid.store.study import open_study
    from rovid.trial.axis import axis_named

    study = open_study([folder], cutoff=task.cutoff, axis=axis_named(task.axis))
    diagnosis = study.diagnosis()
    trials = () if study.campaign is None else study.campaign.trials
    began = [trial.start_epoch for trial in trials if trial.start_epoch is not None]
    return {
        "vehicle": study.vehicle.name,
        "start": min(began, default=None),
        "seconds": sum(trial.duration for trial in trials) if trials else None,
        "diagnosis": diagnosis_document(diagnosis, study),
    }


def _peak_memory() -> int | None:
    """Bytes that this process has taken at most; None where the system does not say."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
