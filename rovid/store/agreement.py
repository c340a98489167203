"""Whether two methods say the same of one parameter, and which one to believe where they do not."""

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

# Joint standard errors beyond which two methods do not say the same.
_APART = 3.0
# Methods that fit all parameters at once.
JOINT_METHODS = (InnovationLikelihood.method, MultiStepLikelihood.method)
_BASE = ("inertia", "quadratic_drag", "linear_drag")


def method_disagreement(entries: Mapping[str, Entry], estimate: Estimate) -> list[str]:
    """One line on the parameter of ``estimate`` that another method, in ``entries``, has farthest off; none if none is.

    Where both rest on the same logs their errors are not independent, and the line comes late rather than early.
    """
    gaps = {name: _gap(entries[name], estimate, name) for name in _BASE if _compared(entries, estimate, name)}
    worst = max(gaps, key=lambda name: gaps[name], default=None)
    if worst is None or gaps[worst] <= _APART:
        return []
    entry, unit = entries[worst], estimate.unit(worst)
    here = plus_minus(estimate.value(worst), estimate.standard_error(worst))
    there = plus_minus(entry.value, entry.standard_error)
    mine, theirs = effect_titles(estimate.names), effect_titles(entries)
    if mine != theirs and not (mine and theirs):
        # The difference is what the causes do, and no riddle.
        share = (
            relative_deviation(entry.value, estimate.value(worst))
            if mine
            else relative_deviation(estimate.value(worst), entry.value)
        )
        poorer, value = (entry.method, there) if mine else (estimate.method, here)
        return [f"{worst} by {poorer} is {value} {unit}, {share}: that knows nothing of {mine or theirs}."]
    text = (
        f"{worst} is {here} {unit} here and {there} {unit} by {entry.method}: {gaps[worst]:.0f} joint standard errors "
        f"apart. {_advice(entry, estimate)}"
    )
    return [text]


def effect_titles(names: Iterable[str]) -> str:
    """The effects among parameter ``names``, in words; nothing where there are none."""
    return " and ".join(dict.fromkeys(effect_named(key).title for key in effect_ids(names)))


def relative_deviation(value: float, of: float) -> str:
    """How far a ``value`` is from the model's ``of``, in words."""
    share = 100.0 * (value / of - 1.0)
    size = f"{abs(share):.0f}" if abs(share) >= 10.0 else f"{abs(share):.2g}"
    return f"{size} % {'above' if share > 0.0 else 'below'} the model's"


def _compared(entries: Mapping[str, Entry], estimate: Estimate, name: str) -> bool:
    if name not in entries or name not in estimate.names or name in estimate.refused:
        return False
    same = entries[name].method == estimate.method and entries.keys() >= set(estimate.names)
    return not same and entries[name].unit == estimate.unit(name)


def _gap(entry: Entry, estimate: Estimate, name: str) -> float:
    joint = math.hypot(entry.standard_error, estimate.standard_error(name))
    if 0.0 < joint < math.inf:
        return abs(entry.value - estimate.value(name)) / joint
    return 0.0


def _advice(entry: Entry, estimate: Estimate) -> str:
    mine, other = estimate.method in JOINT_METHODS, entry.method in JOINT_METHODS
    if mine and other:
        return "Believe the one whose model has the causes that were found."
    if mine or other:
        which = "this one" if mine else "the other"
        return (
            f"Believe {which}: it takes all logs at once and knows of disturbances. That they differ may mean that a "
            "cause is missing, for which `rovid diagnose` looks."
        )
    return "Believe neither before `rovid fit`, which takes all logs at once and knows of disturbances."
