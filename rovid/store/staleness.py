"""Check whether the inputs of a parameter file are unchanged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import RovidError
from rovid.store.parameter_file import Parameters, Provenance, Source, sha256
from rovid.trial.config import find_config, load_config
from rovid.trial.config_fingerprint import ConfigFingerprint

# Maximum number of items that a message names.
_NAMED = 3


@dataclass(frozen=True, kw_only=True)
class Freshness:
    """Result of the check."""

    changes: tuple[str, ...] = ()  # One clause for each changed input; the parameters are valid if there are none
    remarks: tuple[str, ...] = ()  # Sentences on what could not be checked, and on logs added after the fit

    @property
    def reason(self) -> str:
        """The changes in one clause."""
        more = len(self.changes) - _NAMED
        clauses = [*self.changes[:_NAMED], f"{more} more"] if more > 0 else self.changes
        return "; ".join(clauses)


def check_freshness(stored: Parameters, provenance: Provenance | None) -> Freshness:
    """Compare the inputs of ``stored`` with the current files, and with the ``provenance`` of a study if given."""
    if not stored.entries:
        return Freshness()
    own = _current_settings(stored)
    changes = [*_changed_settings(stored, own, provenance), *_changed_logs(stored, provenance)]
    return Freshness(changes=tuple(dict.fromkeys(changes)), remarks=tuple(_remarks(stored, own, provenance)))


def _current_settings(stored: Parameters) -> ConfigFingerprint | None:
    """Fingerprint of its rovid.toml now; None if the file is missing or invalid, which other checks report."""
    if not stored.logs:
        return None
    try:
        return load_config(find_config(stored.logs), stored.axis).fingerprint
    except RovidError:
        return None


def _changed_settings(
    stored: Parameters, own: ConfigFingerprint | None, provenance: Provenance | None
) -> Iterator[str]:
    # Tables of results do not depend on rovid.toml.
    if stored.settings is None or not stored.settings.signals:
        return
    if own is not None:
        yield from stored.settings.changes(own)
    if provenance is not None and provenance.logs != stored.logs and provenance.settings.signals:
        # Other logs may have other columns; only the thrusters have to be the same.
        yield from stored.settings.changes(provenance.settings, drive_alone=True)


def _changed_logs(stored: Parameters, provenance: Provenance | None) -> Iterator[str]:
    by_path: dict[Path | None, str] = {}
    by_name: dict[str, str] = {}
    if provenance is not None:
        # Reuses the digests of the study, because logs may be large.
        by_path = {source.path: source.sha256 for source in provenance.sources}
        if provenance.logs == stored.logs:
            by_name = {source.name: source.sha256 for source in provenance.sources}
    for source in stored.sources:
        path = _find(stored, source)
        if path is not None:
            digest = by_path.get(path) or sha256(path)
        elif _is_gone(stored, source.path):
            yield f"{source.name} is gone"
            continue
        else:
            digest = by_name.get(source.name, source.sha256)
        if digest != source.sha256:
            yield f"{source.name} has changed"


def _find(stored: Parameters, source: Source) -> Path | None:
    """Path of a log: its stored path, or its name in LOGS, which may have moved; None if neither exists."""
    if source.path is None:
        return None
    paths = (source.path, *(logs / source.name for logs in stored.logs))
    return next((path for path in paths if path.is_file()), None)


def _is_gone(stored: Parameters, log: Path | None) -> bool:
    """Whether a ``log`` is missing although its folder, or the LOGS that contained it, still exist."""
    if log is None:
        return False
    return log.parent.exists() or any(logs.exists() and log.is_relative_to(logs) for logs in stored.logs)


def _remarks(stored: Parameters, own: ConfigFingerprint | None, provenance: Provenance | None) -> Iterator[str]:
    name = stored.path.name
    if stored.settings is None:
        yield (
            f"{name} was written by rovid 0.2 or earlier and does not name its inputs, so rovid cannot check whether "
            "it is up to date. The next fit stores them."
        )
    elif stored.settings.signals and own is None:
        yield f"The logs and rovid.toml of {name} have moved, so rovid cannot check whether it is up to date."
    if provenance is not None and provenance.logs == stored.logs and stored.sources:
        fitted = [source.name for source in stored.sources]
        present = [source.name for source in provenance.sources]
        if new := [log for log in present if log not in fitted]:
            yield f"{_several(new)}: added after the fit and not part of it."
        if missing := [log for log in fitted if log not in present]:
            yield f"{_several(missing)}: part of the fit, but not among these logs."


def _several(names: Sequence[str]) -> str:
    names = list(dict.fromkeys(names))
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{', '.join(names[:_NAMED])}{more}"
