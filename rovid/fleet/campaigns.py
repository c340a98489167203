"""The campaigns of a fleet: search, names, digests of their input, and the diagnosis of each in its own process."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Self

from rovid import __version__
from rovid.core.errors import ConfigError, RovidError
from rovid.core.formatting import encodable, to_json
from rovid.core.input_files import special_kind
from rovid.core.threads import CORES_VARIABLE
from rovid.store.study import input_files
from rovid.trial.config import FILE_NAME
from rovid.trial.log_files import is_log

SCHEMA = "rovid-campaign/1"


@dataclass(frozen=True, kw_only=True)
class CampaignTask:
    """A campaign to diagnose."""

    name: str
    folder: str  # Absolute path
    axis: str
    cutoff: float | None  # Low-pass cut-off in Hz; None: chosen from the data
    digest: str  # Digest of everything the diagnosis depends on; empty if the input cannot be read


@dataclass(frozen=True, kw_only=True)
class CampaignRecord:
    """The outcome of one campaign. The field names are the keys of its JSON file."""

    campaign: str
    folder: str
    rovid: str = __version__
    digest: str
    vehicle: str | None = None
    start: float | None = None  # Start of the first log, in s since 1970; None if unknown
    seconds: float | None = None  # Total duration of the logs; None for tables
    took: float | None = None  # Duration of the diagnosis in s
    peak_memory: int | None = None  # Largest memory of the process in bytes; None if unknown
    error: str | None = None  # Reason why there is no diagnosis; None if there is one
    failure: str | None = None  # "input" (a retry gives the same error), "timeout", "crash" or None
    patience: float | None = None  # Time limit of the run in s
    diagnosis: Mapping[str, Any] | None = None  # The document of `rovid diagnose --json`

    @property
    def text(self) -> str:
        """The JSON file."""
        return to_json({"schema": SCHEMA, **asdict(self)}) + "\n"

    @property
    def reduced(self) -> Self:
        """The record with only those parts of the diagnosis that table and page need, to save memory."""
        if self.diagnosis is None:
            return self
        reduced = {key: self.diagnosis[key] for key in ("verdict", "guessed")}
        for kind in ("findings", "suspects"):
            reduced[kind] = [{"effect": finding["effect"]} for finding in self.diagnosis[kind]]
        for side in ("base", "extended"):
            model = self.diagnosis[side]
            reduced[side] = model and {"parameters": model["parameters"]}
        return replace(self, diagnosis=reduced)

    def is_valid_for(self, task: CampaignTask, patience: float) -> bool:
        """Whether a new diagnosis with this time limit in s would give the same result."""
        if not task.digest or self.digest != task.digest:
            return False
        if self.failure == "timeout":
            return patience <= (self.patience or 0.0)
        return self.failure in {None, "input"}


def read_record(path: Path) -> CampaignRecord | None:
    """Read a record; None if the file is missing, damaged or of another schema."""
    try:
        document = json.loads(path.read_bytes())
        if document.pop("schema") != SCHEMA:
            return None
        return CampaignRecord(**document)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def campaign_digest(folder: Path, axis: str, cutoff: float | None) -> str:
    """Digest of the input files, the version of rovid and the options; empty if a file cannot be read."""
    parts = []
    try:
        files = {os.path.relpath(path, folder): path for path in input_files([folder])}
        for name in sorted(files):
            with files[name].open("rb") as stream:
                parts.append([name, hashlib.file_digest(stream, "sha256").hexdigest()])
    except (OSError, RovidError):
        return ""
    return hashlib.sha256(json.dumps([__version__, axis, cutoff, parts]).encode()).hexdigest()


def find_campaigns(folders: Sequence[Path], out: Path) -> dict[str, Path]:
    """Unique name -> absolute path of each campaign in ``folders``, sorted by name.

    A folder with a rovid.toml is one campaign, including its subfolders. Any other folder is searched for such folders.
    A folder with logs outside of every campaign counts as a campaign too, because its record then reports the missing
    rovid.toml. So does a given folder without any campaign. The output folder ``out`` is skipped. Raises ConfigError if
    ``out`` lies in a campaign, or none of the folders exists.
    """
    if not any(folder.exists() for folder in folders):
        raise ConfigError("there is no such folder.", where=folders[0], mend="Give folders of campaigns.")
    out = _absolute(out)
    found = dict.fromkeys(campaign for folder in folders for campaign in _search(_absolute(folder), out))
    for folder in found:
        if out.resolve().is_relative_to(folder.resolve()):
            text = f"lies in the campaign {folder}. The results would be read as logs of that campaign."
            raise ConfigError(text, where=f"-o {out}", mend="Choose a folder outside of the campaign.")
    # A link to another folder of the list is not a second campaign.
    unique = {folder.resolve(): folder for folder in reversed(found)}
    return dict(sorted(_names(list(unique.values())).items()))


def _absolute(path: Path) -> Path:
    return Path(os.path.normpath(path.absolute()))


def _search(folder: Path, out: Path) -> Iterator[Path]:
    """Campaigns in one given folder."""
    campaigns, log_folders = list[Path](), list[Path]()
    if folder.is_dir() and not _is_campaign(folder):
        for name, subfolders, files in os.walk(folder):
            here = Path(name)
            if _is_campaign(here):
                campaigns.append(here)
                subfolders.clear()
                continue
            subfolders[:] = sorted(name for name in subfolders if not name.startswith(".") and here / name != out)
            if any(not name.startswith(".") and is_log(here / name) for name in files):
                log_folders.append(here)
    if not campaigns:
        yield folder
        return
    yield from campaigns
    # Folders of logs without a rovid.toml: the highest folder above each that contains no campaign.
    for here in log_folders:
        parents = [parent for parent in (here, *here.parents) if parent != folder and parent.is_relative_to(folder)]
        free = [parent for parent in parents if not any(campaign.is_relative_to(parent) for campaign in campaigns)]
        if free:
            yield free[-1]


def _is_campaign(folder: Path) -> bool:
    return (folder / FILE_NAME).is_file() or bool(special_kind(folder / FILE_NAME))


def _names(folders: Sequence[Path]) -> dict[str, Path]:
    """Folders by the shortest end of their path that is unique."""
    lengths = dict.fromkeys(folders, 1)
    while True:
        names = {folder: encodable("/".join(folder.parts[1:][-n:])) or "campaign" for folder, n in lengths.items()}
        counts = Counter(names.values())
        ambiguous = [folder for folder, name in names.items() if counts[name] > 1]
        if not ambiguous:
            return {name: folder for folder, name in names.items()}
        for folder in ambiguous:
            lengths[folder] += 1


# The process settings come first, because the imports allocate most of the long-lived objects.
_CODE = "from rovid.core.threads import tune_process; tune_process(); from rovid.fleet.campaigns import main; main()"

# Factor on the budget of a diagnosis, because campaigns share the cores with others.
_SHARED_CORES = 10.0
_NO_WINDOW = getattr(subprocess, "CREATE_NO_WINDOW", 0)  # on Windows


def diagnose_campaign(task: CampaignTask, patience: float, cores: int) -> CampaignRecord:
    """Diagnose ``task`` in a process with a time limit of ``patience`` s; errors of the task go into the record."""
    began = time.monotonic()
    command = [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {_CODE}", json.dumps(asdict(task))]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", CORES_VARIABLE: str(cores)}
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        # The process ends when its standard input closes, so it cannot outlive this one.
        with subprocess.Popen(  # noqa: S603 - Python itself
            command, stdin=subprocess.PIPE, stdout=output, stderr=errors, env=environment, creationflags=_NO_WINDOW
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
            errors.seek(0)
            error = _crash_message(status, errors.read().decode("utf-8", "replace"))
            return _failed(task, error, "crash", patience, took)
        output.seek(0)
        document = json.loads(output.read())
        del document["schema"]
        return replace(CampaignRecord(**document), took=round(took, 3), patience=patience)


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

    def exit_with_parent() -> None:
        # The parent never writes: the read ends when the pipe closes.
        sys.stdin.read()
        os._exit(1)

    threading.Thread(target=exit_with_parent, daemon=True).start()
    output.write(campaign_record(CampaignTask(**json.loads(sys.argv[1]))).text)
    output.flush()
    # Threads and helper processes that still wait are not needed any more.
    os._exit(0)


def campaign_record(task: CampaignTask) -> CampaignRecord:
    """Record with the campaign's diagnosis, or with the user's error."""
    folder = Path(task.folder)
    try:
        from rovid.present.documents.diagnosis import diagnosis_document
        from rovid.store.study import open_study
        from rovid.trial.axis import axis_named

        study = open_study([folder], cutoff=task.cutoff, axis=axis_named(task.axis))
        diagnosis = study.diagnosis(budget=_SHARED_CORES * study.default_budget)
        trials = () if study.campaign is None else study.campaign.trials
        result: dict[str, Any] = {
            "vehicle": study.vehicle.name,
            "start": min((trial.start_epoch for trial in trials if trial.start_epoch is not None), default=None),
            "seconds": sum(trial.duration for trial in trials) if trials else None,
            "diagnosis": diagnosis_document(diagnosis, study),
        }
    except RovidError as error:
        # Paths relative to the campaign: the message does not depend on the folder of the fleet.
        text = str(error).replace(f"{folder}{os.sep}", "").replace(str(folder), task.name)
        result = {"error": text, "failure": "input"}
    return CampaignRecord(
        campaign=task.name, folder=task.folder, digest=task.digest, peak_memory=_peak_memory(), **result
    )


def _peak_memory() -> int | None:
    """Largest memory of this process in bytes; None where the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
