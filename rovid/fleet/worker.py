"""Diagnosis of one campaign in a process of its own: a crash does not stop the fleet, and its memory is released."""

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
from rovid.fleet.campaigns import CampaignRecord, CampaignTask

# The process settings come first, because the imports allocate most of the long-lived objects.
_CODE = (
    "from rovid.core.process_tuning import tune_process; tune_process(); from rovid.fleet.worker import main; main()"
)

# Factor on the budget of a diagnosis, because campaigns share the cores with others.
_SHARED_CORES = 10.0


def diagnose_campaign(task: CampaignTask, patience: float, cores: int) -> CampaignRecord:
    """Diagnose ``task`` in a process with a time limit of ``patience`` s; errors of the task go into the record."""
    began = time.monotonic()
    command = [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {_CODE}", json.dumps(asdict(task))]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", CORES_VARIABLE: str(cores)}
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        # The process ends when its standard input closes, so it cannot outlive this one.
        with subprocess.Popen(  # noqa: S603 - Python itself
            command,
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=errors,
            env=environment,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        ) as process:
            try:
                status = process.wait(patience)
            except subprocess.TimeoutExpired:
                process.kill()
                error = f"no diagnosis within {patience:g} s. Increase the limit with --timeout."
                return _failed(task, error, "timeout", patience, time.monotonic() - began)
            except BaseException:
                process.kill()
                raise
        took = time.monotonic() - began
        if status:
            error = _crash_message(status, _read(errors).decode("utf-8", "replace"))
            return _failed(task, error, "crash", patience, took)
        document = json.loads(_read(output))
        del document["schema"]
        return replace(CampaignRecord(**document), took=round(took, 3), patience=patience)


def _read(file: IO[bytes]) -> bytes:
    file.seek(0)
    return file.read()


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


def _crash_message(status: int, errors: str) -> str:
    lines = errors.strip().splitlines()
    last = f": {lines[-1].strip()}" if lines else ""
    if status >= 0:
        return f"its process ended with status {status}{last}"
    try:
        name = signal.Signals(-status).name
    except ValueError:
        name = f"signal {-status}"
    return f"its process was ended by {name}{last}."


def main() -> None:
    """Diagnose the campaign of the first argument and print the record; the entry point of the process."""
    output, sys.stdout = sys.stdout, sys.stderr
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    output.write(campaign_record(CampaignTask(**json.loads(sys.argv[1]))).text)
    output.flush()
    # Threads and helper processes that still wait are not needed any more.
    os._exit(0)


def _exit_with_parent() -> None:
    # The parent never writes: the read ends when the pipe closes.
    sys.stdin.read()
    os._exit(1)


def campaign_record(task: CampaignTask) -> CampaignRecord:
    """Record with the campaign's diagnosis, or with the user's error."""
    folder = Path(task.folder)
    try:
        result = _diagnose(folder, task)
    except RovidError as error:
        # Paths relative to the campaign: the message does not depend on the folder of the fleet.
        text = str(error).replace(f"{folder}{os.sep}", "").replace(str(folder), task.name)
        result = {"error": text, "failure": "input"}
    return CampaignRecord(
        campaign=task.name, folder=task.folder, digest=task.digest, peak_memory=_peak_memory(), **result
    )


def _diagnose(folder: Path, task: CampaignTask) -> Mapping[str, Any]:
    from rovid.present.documents.diagnosis import diagnosis_document
    from rovid.store.study import open_study
    from rovid.trial.axis import axis_named

    study = open_study([folder], cutoff=task.cutoff, axis=axis_named(task.axis))
    diagnosis = study.diagnosis(budget=_SHARED_CORES * study.default_budget)
    trials = () if study.campaign is None else study.campaign.trials
    return {
        "vehicle": study.vehicle.name,
        "start": min((trial.start_epoch for trial in trials if trial.start_epoch is not None), default=None),
        "seconds": sum(trial.duration for trial in trials) if trials else None,
        "diagnosis": diagnosis_document(diagnosis, study),
    }


def _peak_memory() -> int | None:
    """Largest memory of this process in bytes; None where the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
