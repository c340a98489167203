"""One of two campaigns that are compared: logs that were diagnosed, or what a parameter file says."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.diagnose.result import Diagnosis, Finding
from rovid.diagnose.signal_regressors import is_signal
from rovid.effects import Effect, effect_named
from rovid.effects.bias_torque import EFFECT as BIAS
from rovid.effects.per_trial import trials_in_form
from rovid.effects.thruster_imbalance import WITH_OTHERS
from rovid.estimate.estimate import Estimate
from rovid.estimate.maximum_likelihood import fit_likelihood
from rovid.model.model import Model
from rovid.model.parameter_names import base_names, effect_ids
from rovid.signals.preprocessing import Run, shared_channels
from rovid.store.parameter_file import Parameters, Source
from rovid.store.study import Study
from rovid.trial.axis import Axis
from rovid.trial.config_fingerprint import ConfigFingerprint
from rovid.trial.vehicle import Vehicle

# A suspect that is likelier than not is put into both models, lest it pull at the rest of one.
_LIKELY = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class CampaignFit:
    """What is known of one campaign by itself.

    Attributes
    ----------
    name
        The folder or file, as the user knows it.
    vehicle_name
        What its rovid.toml calls the vehicle.
    settings
        What of rovid.toml it rests on; None where that is not known.
    sources
        Its logs, by their digests.
    stored
        What a parameter file says; None of logs.
    study, diagnosis
        Of logs, the latter as soon as they are diagnosed; None of a parameter file.
    seen
        Of a parameter file, id of each cause that was looked for and not found -> size that would have been seen.
        Empty where nobody looked.
    """

    name: str
    axis: Axis
    vehicle_name: str
    settings: ConfigFingerprint | None
    sources: tuple[Source, ...]
    stored_estimate: Estimate | None = None
    study: Study | None = None
    diagnosis: Diagnosis | None = None
    detection_limits: Mapping[str, float] = field(default_factory=dict)

    @property
    def runs(self) -> Sequence[Run]:
        """None of a parameter file."""
        return () if self.study is None or self.study.runs is None else self.study.runs.items

    @property
    def vehicle(self) -> Vehicle:
        """Of logs alone."""
        assert self.study is not None  # noqa: S101 - a file is not asked
        return self.study.vehicle

    @cached_property
    def model(self) -> Model | None:
        """The free-running model that the diagnosis ended with, without what is of its own trials alone.

        None where there is no diagnosis.
        """
        if self.diagnosis is None or self.diagnosis.extended is None:
            return None
        model = self.diagnosis.extended.model
        kept: list[Effect] = []
        values: list[float] = []
        at = 0
        for effect in model.effects:
            own = model.effect_values[at : at + len(effect.parameters)]
            at += len(effect.parameters)
            if not _is_own(effect):
                kept.append(effect)
                values += own
        return replace(model, effects=tuple(kept), effect_values=tuple(values))

    @property
    def found_effects(self) -> list[Effect]:
        """Causes that are established, or stand in the parameter file."""
        if self.stored_estimate is not None:
            return [effect_named(key) for key in effect_ids(self.stored_estimate.names)]
        return [] if self.diagnosis is None else [finding.effect for finding in self.diagnosis.findings]

    @property
    def likely_findings(self) -> list[Finding]:
        """Causes that are established, or likelier than not."""
        if self.diagnosis is None:
            return []
        suspects = [one for one in self.diagnosis.suspects if one.probability >= _LIKELY]
        return [*self.diagnosis.findings, *suspects]

    @property
    def campaign_specific(self) -> list[Effect]:
        """What its model has and no other campaign's can have: sizes of single trials, mere signals, waves."""
        if self.diagnosis is None or self.diagnosis.extended is None:
            return []
        return [effect for effect in self.diagnosis.extended.model.effects if _is_own(effect)]

    def has_signals_for(self, effect: Effect) -> bool:
        """Whether its logs hold the signals that ``effect`` needs."""
        return set(effect.needs) <= set(shared_channels(self.runs))


@dataclass(frozen=True, kw_only=True, eq=False)
class SharedEstimate:
    """What one campaign says of the parameters that both are asked for.

    Attributes
    ----------
    values, covariance
        (p,) and (p, p) of ``names``.
    white
        Whether its model explains the data to the noise.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    white: bool
    samples: int
    warnings: tuple[str, ...] = ()


def campaign_from_study(study: Study, name: str) -> CampaignFit:
    """The logs of ``study``, which are not diagnosed yet.

    Raises
    ------
    DataError
        They are tables.
    """
    if study.runs is None:
        raise DataError("holds tables; logs, or a parameter file, were expected.", where=name, mend="Give logs.")
    origin = study.provenance
    return CampaignFit(
        name=name,
        axis=study.vehicle.axis,
        vehicle_name=origin.vehicle,
        settings=origin.settings,
        sources=origin.sources,
        study=study,
    )


def with_diagnosis(day: CampaignFit, report: Callable[[str], None] = lambda _: None) -> CampaignFit:
    """``day`` with the diagnosis of its logs, where it has logs and none yet.

    Raises
    ------
    DataError
        They tell too little.
    """
    if day.study is None or day.diagnosis is not None:
        return day
    diagnosis = day.study.diagnosis(lambda text: report(f"{day.name}: {text}"))
    if diagnosis.extended is None:
        raise DataError(f"tells too little to be compared: {diagnosis.missing}", where=day.name)
    return replace(day, diagnosis=diagnosis)


def campaign_from_parameters(stored: Parameters, name: str, seen: Mapping[str, float] | None = None) -> CampaignFit:
    """What a parameter file says.

    Raises
    ------
    DataError
        It lacks inertia or drag.
    """
    names = [one for one in base_names(stored.axis) if one in stored.entries]
    if "quadratic_drag" not in names or ("inertia" not in names and not stored.per_inertia):
        raise DataError(
            "holds no inertia or no drag, so that there is nothing to compare.", where=name, mend="Run `rovid fit`."
        )
    names += [one for one in stored.entries if "." in one]
    return CampaignFit(
        name=name,
        axis=stored.axis,
        vehicle_name=stored.vehicle,
        settings=stored.settings,
        sources=stored.sources,
        stored_estimate=stored.estimate(names),
        detection_limits={} if seen is None else seen,
    )


def shared_estimate(day: CampaignFit, effects: Sequence[Effect]) -> SharedEstimate:
    """What ``day`` says of inertia, drag and ``effects``, by a fit of all at once where there are logs.

    A constant torque is fitted beside them: another day's trim is no change of the vehicle.

    Raises
    ------
    DataError
        The vehicle was not excited enough.
    """
    if day.stored_estimate is not None:
        return _as_written(day, day.stored_estimate, effects)
    own = day.campaign_specific
    taken = {effect.id for effect in (*own, *effects)}
    if BIAS.id not in taken and day.axis.name in BIAS.axes:
        own = [*own, BIAS]
    try:
        fit = fit_likelihood(day.runs, day.vehicle, (*own, *effects))
    except DataError as error:
        raise DataError(str(error), where=day.name) from error
    estimate = fit.estimate
    wanted = (*base_names(day.axis), *_parameters_of(effects))
    names = tuple(name for name in wanted if name in estimate.names and name not in estimate.refused)
    at = [estimate.names.index(name) for name in names]
    return SharedEstimate(
        names=names,
        units=tuple(estimate.unit(name) for name in names),
        values=estimate.values[at],
        covariance=estimate.covariance[np.ix_(at, at)],
        white=fit.white,
        samples=estimate.samples,
        warnings=estimate.warnings,
    )


def _as_written(day: CampaignFit, estimate: Estimate, effects: Sequence[Effect]) -> SharedEstimate:
    """What a parameter file says; of a cause that was looked for and not found, how large it may be."""
    names = [name for name in base_names(day.axis) if name in estimate.names and name not in estimate.refused]
    values = [estimate.value(name) for name in names]
    at = [estimate.names.index(name) for name in names]
    absent: dict[str, tuple[float, float]] = {}
    for effect in effects:
        for parameter in effect.parameters:
            name = f"{effect.key}.{parameter.name}"
            if name in estimate.names:
                at.append(estimate.names.index(name))
                names.append(name)
                values.append(estimate.value(name))
            elif parameter is effect.parameters[0] and math.isfinite(day.detection_limits.get(effect.id, math.nan)):
                absent[name] = (parameter.neutral, 0.5 * day.detection_limits[effect.id])
    covariance = np.zeros((len(names) + len(absent),) * 2)
    covariance[: len(at), : len(at)] = estimate.covariance[np.ix_(at, at)]
    for place, (_, error) in enumerate(absent.values(), start=len(at)):
        covariance[place, place] = error**2
    every = (*names, *absent)
    return SharedEstimate(
        names=every,
        units=tuple(estimate.unit(name) for name in every),
        values=np.array([*values, *(null for null, _ in absent.values())]),
        covariance=covariance,
        white=False,
        samples=sum(source.samples for source in day.sources),
    )


def shared_effects(a: CampaignFit, b: CampaignFit) -> list[Effect]:
    """Causes of either that both models are to have, the best form of each.

    What is of a day alone is among them, lest it pull at the rest, and compared by itself.
    """
    if not a.runs or not b.runs:
        both = {effect.key: effect for day in (a, b) for effect in day.found_effects if not _is_own(effect)}
        return list(both.values())
    best: dict[str, Finding] = {}
    for one in (*a.likely_findings, *b.likely_findings):
        if _is_own(one.effect) or not (a.has_signals_for(one.effect) and b.has_signals_for(one.effect)):
            continue
        thruster = one.effect.form.removesuffix(WITH_OTHERS) if one.effect.per_thruster else ""
        place = f"{one.effect.id}:{thruster}"
        if place not in best or one.bic_gain > best[place].bic_gain:
            best[place] = one
    strongest = sorted(best.values(), key=lambda one: -one.bic_gain)
    # All thrusters weaker alike is a matter of scale, which nothing shows: one of them stays as it is.
    weak = [one for one in strongest if one.effect.per_thruster]
    spare = weak[max(len(a.vehicle.thrusters) - 1, 1) :]
    return [one.effect for one in strongest if one not in spare]


def _is_own(effect: Effect) -> bool:
    return is_signal(effect) or bool(trials_in_form(effect.form)) or effect.is_wave


def _parameters_of(effects: Sequence[Effect]) -> list[str]:
    return [f"{effect.key}.{parameter.name}" for effect in effects for parameter in effect.parameters]
