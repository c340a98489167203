"""When to stop: what has to be known, and how well."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rovid.core.errors import ConfigError, suggestion
from rovid.diagnose.result import Diagnosis
from rovid.effects import EFFECTS, effect_named
from rovid.estimate.estimate import Estimate
from rovid.model.parameter_names import base_names, without_form
from rovid.trial.axis import Axis

_ONE = re.compile(r"\s*([A-Za-z_][\w.:@ -]*?)\s+(?:to\s+)?(\d+(?:\.\d+)?)\s*%\s*")


@dataclass(frozen=True, kw_only=True)
class StopCriterion:
    """A parameter known within a share of its value, by its 95 % interval; or a cause as sure as a share.

    Attributes
    ----------
    name
        Of a parameter, or the id of an effect.
    share
        1 for 100 %.
    of_cause
        Whether it is an effect's.
    """

    name: str
    share: float
    is_effect: bool

    def __str__(self) -> str:
        """As it is given."""
        return f"{self.name} {100.0 * self.share:g} %"

    def status(self, estimate: Estimate | None, diagnosis: Diagnosis | None) -> CriterionStatus:
        """How far it is met by what is known now."""
        now = _sure_of(self.name, diagnosis) if self.is_effect else _within(self.name, estimate)
        met = now is not None and (now >= self.share if self.is_effect else now <= self.share)
        return CriterionStatus(criterion=self, current=now, met=met)


@dataclass(frozen=True, kw_only=True)
class CriterionStatus:
    """How far a condition is met; ``now`` is None where nothing is known."""

    criterion: StopCriterion
    current: float | None
    met: bool


def parse_criteria(text: str, axis: Axis, *, diagnosed: bool = True) -> tuple[StopCriterion, ...]:
    """What ``text``, as "inertia 2 %, quadratic_drag 5 %", asks for; of causes only where there is a diagnosis.

    Raises
    ------
    ConfigError
        It is not understood, or names no parameter and no effect.
    """
    found = []
    for part in text.split(","):
        one = _ONE.fullmatch(part)
        if one is None:
            raise ConfigError(
                f"is {part.strip()!r}; a name and a percentage were expected.",
                where="--until",
                mend='As in --until "inertia 2 %, quadratic_drag 5 %".',
            )
        found.append(_condition(one[1], float(one[2]) / 100.0, axis, diagnosed=diagnosed))
    return tuple(dict.fromkeys(found))


def _condition(words: str, share: float, axis: Axis, *, diagnosed: bool) -> StopCriterion:
    name = re.sub(r"[ -]+", "_", words)
    known = {*base_names(axis), *EFFECTS}
    key, _, parameter = name.rpartition(".")
    if key:
        parameters = [one.name for one in effect_named(key).parameters]
        if parameter not in parameters:
            raise ConfigError(
                f"{parameter!r} is no parameter of {key}. {suggestion(parameter, parameters)}", where="--until"
            )
    elif name not in known:
        raise ConfigError(f"{name!r} is no parameter and no effect. {suggestion(name, sorted(known))}", where="--until")
    of_cause = not key and name not in base_names(axis)
    if of_cause and not diagnosed:
        raise ConfigError(
            f"asks for {name}, which only a diagnosis finds.", where="--until", mend="Leave --no-diagnosis out."
        )
    if share <= 0.0 or (of_cause and share >= 1.0):
        raise ConfigError(f"{name} {100.0 * share:g} % cannot be reached.", where="--until")
    return StopCriterion(name=name, share=share, is_effect=of_cause)


def _within(name: str, estimate: Estimate | None) -> float | None:
    """How well a parameter is known; None where no size is."""
    if estimate is None:
        return None
    for full in estimate.names:
        if without_form(full) == name and full not in estimate.refused and not estimate.is_placeholder(full):
            return relative_half_width(estimate, full)
    return None


def relative_half_width(estimate: Estimate, name: str) -> float | None:
    """The farther end of the 95 % interval from the value, as a share of it; None of nothing."""
    value = estimate.value(name)
    reach = max(abs(end - value) for end in estimate.interval(name))
    return reach / abs(value) if value else None


def _sure_of(name: str, diagnosis: Diagnosis | None) -> float | None:
    if diagnosis is None:
        return None
    every: Sequence[float] = [
        one.probability for one in (*diagnosis.findings, *diagnosis.suspects) if one.effect.id == name
    ]
    return max(every, default=0.0)
