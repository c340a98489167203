"""The record of one campaign: its diagnosis, or the reason why there is none, with a digest of the input."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rovid import __version__
from rovid.core.errors import RovidError
from rovid.core.formatting import to_json
from rovid.store.study import input_files

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
    def reduced(self) -> CampaignRecord:
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
