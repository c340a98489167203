"""A log read in a process of its own, forked from one that has imported all that reads."""

from __future__ import annotations

import multiprocessing
import warnings
from multiprocessing.connection import Connection
from pathlib import Path

from rovid.core.errors import RovidError
from rovid.preflight.log_survey import survey
from rovid.readers import read_log
from rovid.trial.config import load_config

STATUS = Path("/proc/self/status")


def read(path: Path, what: str = "read") -> tuple[int, str]:
    """(bytes of memory at most, what was said) of ``path``, read by the rovid.toml beside it; "init": surveyed."""
    forks = multiprocessing.get_context("forkserver")
    forks.set_forkserver_preload([__name__, "pandas", "pyarrow.parquet"])
    here, there = forks.Pipe(duplex=False)
    process = forks.Process(target=_read, args=(there, path, what))
    process.start()
    there.close()
    try:
        assert here.poll(30.0), f"{path.name}: nothing within half a minute"
        memory, found = here.recv()
    finally:
        process.kill()
        process.join()
    return memory, found


def _read(there: Connection, path: Path, what: str) -> None:
    warnings.simplefilter("error")
    try:
        if what == "init":
            surveyed = survey([path])
            found = " ".join([*surveyed.warnings, *(f"no {what}" for what in surveyed.unrecognised)])
        else:
            trial = read_log(path, load_config(path.with_name("rovid.toml")))
            found = f"{len(trial.time)} samples"
            if what == "measured":
                found = "\n".join([str(trial.measured.sum()), *(remark.text for remark in trial.remarks)])
    except RovidError as error:
        found = str(error)
    # Of this process alone: getrusage counts in what the one had that it was forked from.
    most = next(line for line in STATUS.read_text().splitlines() if line.startswith("VmHWM"))
    there.send((int(most.split()[1]) * 1024, found))
