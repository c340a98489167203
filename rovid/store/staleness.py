"""Whether a parameter file still holds: whether what it rests on is as it was."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import RovidError
from rovid.store.parameter_file import Parameters, Provenance, Source, sha256
from rovid.trial.config import find_config, load_config
from rovid.trial.config_fingerprint import ConfigFingerprint

_NAMED = 3


@dataclass(frozen=True, kw_only=True)
class Freshness:
    """What is known of a parameter file.

    Attributes
    ----------
    changed
        What it rests on and is not as it was, a clause each; the parameters hold where there is none.
    remarks
        Sentences on what cannot be told, and on logs that came after the fit.
    """

    changes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def reason(self) -> str:
        """What has changed, in a clause."""
        more = len(self.changes) - _NAMED
        return "; ".join((*self.changes[:_NAMED], *[f"{more} more"] * (more > 0)))


def check_freshness(stored: Parameters, origin: Provenance | None) -> Freshness:
    """How ``stored`` stands, from the files that it rests on; ``origin`` is of the study at hand, if there is one."""
    if not stored.entries:
        return Freshness()
    own = _own_settings(stored)
    changed = [*_changed_settings(stored, own, origin), *_changed_logs(stored, origin)]
    return Freshness(changes=tuple(dict.fromkeys(changed)), remarks=tuple(_remarks(stored, own, origin)))


def _own_settings(stored: Parameters) -> ConfigFingerprint | None:
    """What its own rovid.toml says now; None where that is not there, or cannot be read, which others will say."""
    if not stored.logs:
        return None
    try:
        return load_config(find_config(stored.logs), stored.axis).fingerprint
    except RovidError:
        return None


def _changed_settings(stored: Parameters, own: ConfigFingerprint | None, origin: Provenance | None) -> Iterator[str]:
    # Tables of results rest on nothing in rovid.toml.
    if stored.settings is None or not stored.settings.signals:
        return
    if own is not None:
        yield from stored.settings.changes(own)
    if origin is not None and origin.logs != stored.logs and origin.settings.signals:
        # Other logs may hold their signals elsewhere; what drives the vehicle has to be the same.
        yield from stored.settings.changes(origin.settings, drive_alone=True)


def _changed_logs(stored: Parameters, origin: Provenance | None) -> Iterator[str]:
    known = () if origin is None else origin.sources
    # Large logs are read once for their digest.
    digests = {source.path: source.sha256 for source in known}
    named = {source.name: source.sha256 for source in known if origin is not None and origin.logs == stored.logs}
    for source in stored.sources:
        place = _place(stored, source)
        if place is not None:
            now = digests.get(place) or sha256(place)
        elif _is_gone(stored, source.path):
            yield f"{source.name} is gone"
            continue
        else:
            now = named.get(source.name, source.sha256)
        if now != source.sha256:
            yield f"{source.name} has changed"


def _place(stored: Parameters, source: Source) -> Path | None:
    """Where a log is: where it was, or else in LOGS, with which it may have moved; None where it is in neither."""
    if source.path is None:
        return None
    places = (source.path, *(logs / source.name for logs in stored.logs))
    return next((place for place in places if place.is_file()), None)


def _is_gone(stored: Parameters, log: Path | None) -> bool:
    """Whether a ``log`` is missing where its folder, or the LOGS that it was in, are still there."""
    if log is None:
        return False
    return log.parent.exists() or any(logs.exists() and log.is_relative_to(logs) for logs in stored.logs)


def _remarks(stored: Parameters, own: ConfigFingerprint | None, origin: Provenance | None) -> Iterator[str]:
    if stored.settings is None:
        yield (
            f"{stored.path.name} does not say what its parameters rest on, as files of rovid 0.2 and before: whether "
            "they still hold cannot be told. The next fit notes it."
        )
    elif stored.settings.signals and own is None:
        yield f"The logs and rovid.toml of {stored.path.name} are not where they were: whether it holds cannot be told."
    if origin is not None and origin.logs == stored.logs and stored.sources:
        known, here = ({source.name: source for source in sources} for sources in (stored.sources, origin.sources))
        if new := [name for name in here if name not in known]:
            yield f"{_several(new)}: came after the fit, and no parameter rests on it."
        if others := [name for name in known if name not in here]:
            yield f"{_several(others)}: parameters rest on it too, and it is not among these logs."


def _several(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{', '.join(names[:_NAMED])}{more}"
