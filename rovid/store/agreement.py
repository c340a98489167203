"""Comparison of the results of two methods for the same parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from rovid.core.formatting import plus_minus
from rovid.effects import effect_named
from rovid.estimate.estimate import Estimate
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.multi_step_likelihood import MultiStepLikelihood
from rovid.model.parameter_names import effect_ids
from rovid.store.parameter_file import Entry

# Joint standard errors beyond which two methods disagree; a decision.
_LIMIT = 3.0
# Methods that fit all parameters together.
JOINT_METHODS = (InnovationLikelihood.method, MultiStepLikelihood.method)
_BASE = ("inertia", "quadratic_drag", "linear_drag")


def method_disagreement(entries: Mapping[str, Entry], estimate: Estimate) -> list[str]:
    """A warning about the parameter in ``entries`` that differs most from ``estimate``, if it differs too much.

    If both methods used the same logs, their errors are correlated and the test is conservative.
    """
    distances = {
        name: _distance(entries[name], estimate, name) for name in _BASE if _is_compared(entries, estimate, name)
    }
    worst = max(distances, key=distances.__getitem__, default=None)
    if worst is None or distances[worst] <= _LIMIT:
        return []
    entry, value, unit = entries[worst], estimate.value(worst), estimate.unit(worst)
    here = plus_minus(value, estimate.standard_error(worst))
    stored = plus_minus(entry.value, entry.standard_error)
    own, other = effect_titles(estimate.names), effect_titles(entries)
    # If only one of the models has effects, they explain the difference.
    if own and not other:
        deviation = relative_deviation(entry.value, value)
        return [f"{worst} by {entry.method} is {stored} {unit}, {deviation}, because that method does not model {own}."]
    if other and not own:
        deviation = relative_deviation(value, entry.value)
        return [
            f"{worst} by {estimate.method} is {here} {unit}, {deviation}, because this method does not model {other}."
        ]
    text = (
        f"{worst} is {here} {unit} by this method and {stored} {unit} by {entry.method}: they differ by "
        f"{distances[worst]:.0f} joint standard errors. {_advice(entry, estimate)}"
    )
    return [text]


def effect_titles(names: Iterable[str]) -> str:
    """Titles of the effects among parameter ``names``, joined by "and"; empty if there are none."""
    return " and ".join(dict.fromkeys(effect_named(key).title for key in effect_ids(names)))


def relative_deviation(value: float, reference: float) -> str:
    """Deviation of a ``value`` from the model's ``reference`` in words."""
    share = 100.0 * (value / reference - 1.0)
    size = f"{abs(share):.0f}" if abs(share) >= 10.0 else f"{abs(share):.2g}"
    return f"{size} % {'above' if share > 0.0 else 'below'} the model's"


def _is_compared(entries: Mapping[str, Entry], estimate: Estimate, name: str) -> bool:
    if name not in entries or name not in estimate.names or name in estimate.refused:
        return False
    same_method = entries[name].method == estimate.method and entries.keys() >= set(estimate.names)
    return not same_method and entries[name].unit == estimate.unit(name)


def _distance(entry: Entry, estimate: Estimate, name: str) -> float:
    """Difference in joint standard errors."""
    joint = math.hypot(entry.standard_error, estimate.standard_error(name))
    if 0.0 < joint < math.inf:
        return abs(entry.value - estimate.value(name)) / joint
    return 0.0


def _advice(entry: Entry, estimate: Estimate) -> str:
    this, other = estimate.method in JOINT_METHODS, entry.method in JOINT_METHODS
    if this and other:
        return "Use the result of the model with the causes that were found."
    if this or other:
        result = "this result" if this else "the other result"
        return (
            f"Use {result}: it is a joint fit of all logs with a disturbance. The difference may mean that a cause is "
            "missing. Run `rovid diagnose` to look for it."
        )
    return "Use neither before you run `rovid fit`, a joint fit of all logs with a disturbance."
