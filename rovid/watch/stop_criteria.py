"""Stop criteria of a trial day: required precision of parameters and probability of causes."""

from __future__ import annotations

import re
from dataclasses import dataclass

from rovid.core.errors import ConfigError, suggestion
from rovid.diagnose.result import Diagnosis
from rovid.effects import effect_named, every_form
from rovid.estimate.estimate import Estimate
from rovid.model.parameter_names import base_names, without_form
from rovid.trial.axis import Axis

_CRITERION = re.compile(r"\s*([A-Za-z_][\w.:@ -]*?)\s+(?:to\s+)?(\d+(?:\.\d+)?)\s*%\s*")
_OPTION = "--until"


@dataclass(frozen=True, kw_only=True)
class StopCriterion:
    """A required relative half width of a parameter's 95 % interval, or a required probability of a cause."""

    name: str  # Name of a parameter, or id of an effect
    share: float  # Limit; 1 is 100 %
    is_effect: bool  # Whether ``name`` is an effect

    def __str__(self) -> str:
        """The criterion as the user writes it."""
        return f"{self.name} {100.0 * self.share:g} %"

    def status(self, estimate: Estimate | None, diagnosis: Diagnosis | None) -> CriterionStatus:
        """Current value and whether the criterion is met."""
        if self.is_effect:
            current = _probability(self.name, diagnosis)
            met = current is not None and current >= self.share
        else:
            current = _half_width(self.name, estimate)
            met = current is not None and current <= self.share
        return CriterionStatus(criterion=self, current=current, met=met)


@dataclass(frozen=True, kw_only=True)
class CriterionStatus:
    """Progress of a criterion; ``current`` is None if unknown."""

    criterion: StopCriterion
    current: float | None
    met: bool


def parse_criteria(text: str, axis: Axis, *, diagnosed: bool = True) -> tuple[StopCriterion, ...]:
    """Criteria in ``text``, as "inertia 2 %, quadratic_drag 5 %"; causes are only allowed with a diagnosis.

    Raises
    ------
    ConfigError
        The text cannot be parsed, or a name is neither a parameter nor an effect.
    """
    found = []
    for part in text.split(","):
        match = _CRITERION.fullmatch(part)
        if match is None:
            raise ConfigError(
                f"is {part.strip()!r}; a name and a percentage were expected.",
                where=_OPTION,
                mend='As in --until "inertia 2 %, quadratic_drag 5 %".',
            )
        found.append(_criterion(match[1], float(match[2]) / 100.0, axis, diagnosed=diagnosed))
    return tuple(dict.fromkeys(found))


def _criterion(words: str, share: float, axis: Axis, *, diagnosed: bool) -> StopCriterion:
    name = re.sub(r"[ -]+", "_", words)
    known = {*base_names(axis), *(effect.id for effect in every_form())}
    key, _, parameter = name.rpartition(".")
    if key:
        names = [one.name for one in effect_named(key).parameters]
        if parameter not in names:
            raise ConfigError(f"{parameter!r} is no parameter of {key}. {suggestion(parameter, names)}", where=_OPTION)
    elif name not in known:
        text = f"{name!r} is no parameter and no effect. {suggestion(name, sorted(known))}"
        raise ConfigError(text, where=_OPTION)
    is_effect = not key and name not in base_names(axis)
    if is_effect and not diagnosed:
        raise ConfigError(f"needs a diagnosis to find {name}.", where=_OPTION, mend="Leave --no-diagnosis out.")
    if share <= 0.0 or (is_effect and share >= 1.0):
        raise ConfigError(f"{name} {100.0 * share:g} % cannot be reached.", where=_OPTION)
    return StopCriterion(name=name, share=share, is_effect=is_effect)


def _half_width(name: str, estimate: Estimate | None) -> float | None:
    """Relative half width of the first parameter of this name; None if it is unknown or a placeholder."""
    if estimate is None:
        return None
    for full in estimate.names:
        if without_form(full) == name and full not in estimate.refused and not estimate.is_placeholder(full):
            return relative_half_width(estimate, full)
    return None


def relative_half_width(estimate: Estimate, name: str) -> float | None:
    """Larger distance of the 95 % interval's ends from the value, relative to the value; None for a value of zero."""
    value = estimate.value(name)
    if not value:
        return None
    return max(abs(end - value) for end in estimate.interval(name)) / abs(value)


def _probability(name: str, diagnosis: Diagnosis | None) -> float | None:
    """Probability of the effect; 0 if the diagnosis does not name it, None without a diagnosis."""
    if diagnosis is None:
        return None
    causes = (*diagnosis.findings, *diagnosis.suspects)
    return max((float(cause.probability) for cause in causes if cause.effect.id == name), default=0.0)
