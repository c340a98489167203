"""What is kept of a campaign: its diagnosis, or why there is none, and what that comes of."""

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
    """A campaign to be diagnosed.

    Attributes
    ----------
    name
        What it is called.
    folder
        Absolute.
    axis
        Degree of freedom.
    cutoff
        Hz; None: chosen from the data.
    digest
        Of all that the diagnosis comes of; empty where that cannot be read.
    """

    name: str
    folder: str
    axis: str
    cutoff: float | None
    digest: str


@dataclass(frozen=True, kw_only=True)
class CampaignRecord:
    """What came of it; the fields are the keys of its file.

    Attributes
    ----------
    start
        s since 1970 when the first log begins; None where no log tells.
    seconds
        Of all logs together; None where they are tables.
    took
        s that the diagnosis took.
    peak_memory
        Bytes that its process took at most; None where that is not known.
    error
        Why there is no diagnosis; None where there is one.
    failure
        "input" where the error will be the same the next time; "timeout", "crash", or None.
    patience
        s that were given to it.
    diagnosis
        As `rovid diagnose --json` prints it.
    """

    campaign: str
    folder: str
    rovid: str = __version__
    digest: str
    vehicle: str | None = None
    start: float | None = None
    seconds: float | None = None
    took: float | None = None
    peak_memory: int | None = None
    error: str | None = None
    failure: str | None = None
    patience: float | None = None
    diagnosis: Mapping[str, Any] | None = None

    @property
    def text(self) -> str:
        """The file's content."""
        return to_json({"schema": SCHEMA, **asdict(self)}) + "\n"

    @property
    def reduced(self) -> CampaignRecord:
        """It with that alone of its diagnosis which the table and the page need: of many not all is kept in memory."""
        if self.diagnosis is None:
            return self
        lean = {key: self.diagnosis[key] for key in ("verdict", "guessed")}
        for kind in ("findings", "suspects"):
            lean[kind] = [{"effect": one["effect"]} for one in self.diagnosis[kind]]
        for side in ("base", "extended"):
            known = self.diagnosis[side]
            lean[side] = known and {"parameters": known["parameters"]}
        return replace(self, diagnosis=lean)

    def is_valid_for(self, task: CampaignTask, patience: float) -> bool:
        """Whether the diagnosis would come to the same again, as far as that can be told."""
        if not task.digest or self.digest != task.digest:
            return False
        return self.failure in {None, "input"} or (self.failure == "timeout" and patience <= (self.patience or 0.0))


def read_record(path: Path) -> CampaignRecord | None:
    """The record in a file; None where there is none, or it is damaged or another version's."""
    try:
        document = json.loads(path.read_bytes())
        if document.pop("schema") != SCHEMA:
            return None
        return CampaignRecord(**document)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def campaign_digest(folder: Path, axis: str, cutoff: float | None) -> str:
    """Digest of every file that a diagnosis reads, of rovid's version and of the options; empty where one is hidden."""
    try:
        files = {os.path.relpath(path, folder): path for path in input_files([folder])}
        parts = [[name, _digest(files[name])] for name in sorted(files)]
    except (OSError, RovidError):
        return ""
    return hashlib.sha256(json.dumps([__version__, axis, cutoff, parts]).encode()).hexdigest()


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
