"""Parameter files as campaigns, and what a parameter file held before."""

from __future__ import annotations

from pathlib import Path

from rovid.compare.campaign_fit import CampaignFit, campaign_from_parameters
from rovid.core.errors import DataError
from rovid.store.history import HistoryRecord, history_output, read_history
from rovid.store.load import read_parameters
from rovid.store.parameter_file import Parameters


def campaign_from_file(path: Path, name: str) -> CampaignFit:
    """What the parameter file at ``path`` says; what was looked for in vain stands in its history.

    Raises
    ------
    RovidError
        It cannot be read, or holds too little.
    """
    stored = read_parameters(path)
    record = next((one for one in read_history(path) if _same(one.parameters, stored)), None)
    return campaign_from_parameters(stored, name, None if record is None else record.detection_limits)


def previous_campaign(stored: Parameters) -> CampaignFit:
    """The last model in the history of ``stored`` that rests on other logs, or said another thing of the same.

    Raises
    ------
    DataError
        There is none.
    ConfigError
        The history is damaged.
    """
    digests = frozenset(source.sha256 for source in stored.sources)
    records = list(read_history(stored.path))
    of_other_logs = (one for one in records if one.digests != digests)
    found = next(of_other_logs, None) or next((one for one in records if not _same(one.parameters, stored)), None)
    if found is None:
        where = history_output(stored.path).path
        raise DataError(
            "holds no other model to compare with."
            if records
            else "there is no such history of what was found before.",
            where=where,
            mend="Give A and B. Each `rovid fit`, `rovid diagnose` and `rovid report` adds a line to it.",
        )
    return campaign_from_parameters(found.parameters, _name(found, stored), found.detection_limits)


def _name(record: HistoryRecord, stored: Parameters) -> str:
    """A record by its logs, where they are others, and its time."""
    logs = ", ".join(path.name for path in record.parameters.logs)
    told = logs if record.parameters.logs != stored.logs else stored.path.name
    return f"{told} as of {record.written[:16]}"


def _same(one: Parameters, other: Parameters) -> bool:
    """Whether both hold the same model of the same logs."""
    return one.entries == other.entries and one.sources == other.sources
