"""Checks of a parameter file: unchanged inputs, and agreement of the methods for the same parameters."""

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import RovidError, shortened_list
from rovid.core.formatting import plus_minus
from rovid.effects import every_form
from rovid.estimate.estimate import Estimate
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.multi_step import MultiStepLikelihood
from rovid.model.parameter_names import effect_ids
from rovid.store.parameter_file import Entry, Parameters, Provenance, sha256
from rovid.trial.assumptions import ConfigFingerprint
from rovid.trial.config import find_config, load_config

# Joint standard errors beyond which two methods disagree; a decision.
_LIMIT = 3.0
# Methods that fit all parameters together.
JOINT_METHODS = (InnovationLikelihood.method, MultiStepLikelihood.method)
_BASE = ("inertia", "quadratic_drag", "linear_drag")
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
    own = None  # Fingerprint of its rovid.toml now; None if the file is missing or invalid, which other checks report.
    if stored.logs:
        with suppress(RovidError):
            own = load_config(find_config(stored.logs), stored.axis).fingerprint
    changes = [*_changed_settings(stored, own, provenance), *_changed_logs(stored, provenance)]
    return Freshness(changes=tuple(dict.fromkeys(changes)), remarks=tuple(_remarks(stored, own, provenance)))


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
        digest = by_name.get(source.name, source.sha256)
        if (log := source.path) is not None:
            # The stored path of the log, or its name in LOGS, which may have moved.
            paths = (log, *(logs / source.name for logs in stored.logs))
            path = next((path for path in paths if path.is_file()), None)
            if path is not None:
                digest = by_path.get(path) or sha256(path)
            elif log.parent.exists() or any(logs.exists() and log.is_relative_to(logs) for logs in stored.logs):
                yield f"{source.name} is gone"  # Its folder, or the LOGS that contained it, still exist.
                continue
        if digest != source.sha256:
            yield f"{source.name} has changed"


def _remarks(stored: Parameters, own: ConfigFingerprint | None, provenance: Provenance | None) -> Iterator[str]:
    name = stored.path.name
    if stored.settings is None:
        text = f"{name} was written by rovid 0.2 or earlier and does not name its inputs, so rovid cannot check "
        yield f"{text}whether it is up to date. The next fit stores them."
    elif stored.settings.signals and own is None:
        yield f"The logs and rovid.toml of {name} have moved, so rovid cannot check whether it is up to date."
    if provenance is not None and provenance.logs == stored.logs and stored.sources:
        fitted = [source.name for source in stored.sources]
        present = [source.name for source in provenance.sources]
        if new := [log for log in present if log not in fitted]:
            yield f"{shortened_list(dict.fromkeys(new), _NAMED)}: added after the fit and not part of it."
        if missing := [log for log in fitted if log not in present]:
            yield f"{shortened_list(dict.fromkeys(missing), _NAMED)}: part of the fit, but not among these logs."


def method_disagreement(entries: Mapping[str, Entry], estimate: Estimate) -> list[str]:
    """A warning about the parameter in ``entries`` that differs most from ``estimate``, if it differs too much.

    If both methods used the same logs, their errors are correlated and the test is conservative.
    """
    distances = {}
    for name in _BASE:
        if name not in entries or name not in estimate.names or name in estimate.refused:
            continue
        entry = entries[name]
        same_method = entry.method == estimate.method and entries.keys() >= set(estimate.names)
        if not same_method and entry.unit == estimate.unit(name):
            joint = math.hypot(entry.standard_error, estimate.standard_error(name))
            is_known = 0.0 < joint < math.inf
            distances[name] = abs(entry.value - estimate.value(name)) / joint if is_known else 0.0
    worst = max(distances, key=distances.__getitem__, default=None)
    if worst is None or distances[worst] <= _LIMIT:
        return []
    entry, value, unit = entries[worst], estimate.value(worst), estimate.unit(worst)
    here, stored = plus_minus(value, estimate.standard_error(worst)), plus_minus(entry.value, entry.standard_error)
    own, other = effect_titles(estimate.names), effect_titles(entries)
    # If only one of the models has effects, they explain the difference.
    if own and not other:
        deviation = relative_deviation(entry.value, value)
        return [f"{worst} by {entry.method} is {stored} {unit}, {deviation}, because that method does not model {own}."]
    if other and not own:
        text = f"{worst} by {estimate.method} is {here} {unit}, {relative_deviation(value, entry.value)}, because this "
        return [f"{text}method does not model {other}."]
    text = f"{worst} is {here} {unit} by this method and {stored} {unit} by {entry.method}: they differ by "
    text += f"{distances[worst]:.0f} joint standard errors. {_advice(entry, estimate)}"
    return [text]


def effect_titles(names: Iterable[str]) -> str:
    """Titles of the effects among parameter ``names``, joined by "and"; empty if there are none."""
    titles = {effect.id: effect.title for effect in every_form()}
    ids = (key.partition(":")[0] for key in effect_ids(names))
    return " and ".join(dict.fromkeys(titles.get(name, name) for name in ids))


def relative_deviation(value: float, reference: float) -> str:
    """Deviation of a ``value`` from the model's ``reference`` in words."""
    share = 100.0 * (value / reference - 1.0)
    size = f"{abs(share):.0f}" if abs(share) >= 10.0 else f"{abs(share):.2g}"
    return f"{size} % {'above' if share > 0.0 else 'below'} the model's"


def _advice(entry: Entry, estimate: Estimate) -> str:
    this, other = estimate.method in JOINT_METHODS, entry.method in JOINT_METHODS
    if this and other:
        return "Use the result of the model with the causes that were found."
    if this or other:
        result = "this result" if this else "the other result"
        text = f"Use {result}: it is a joint fit of all logs with a disturbance. The difference may mean that a cause "
        return f"{text}is missing. Run `rovid diagnose` to look for it."
    return "Use neither before you run `rovid fit`, a joint fit of all logs with a disturbance."
