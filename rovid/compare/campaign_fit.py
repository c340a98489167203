"""One of the two campaigns of a comparison: diagnosed logs, or the content of a parameter file."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, DataError
from rovid.diagnose.result import Diagnosis, Finding
from rovid.diagnose.signal_regressors import is_signal
from rovid.effects import Effect, effect_named
from rovid.effects.bias_torque import EFFECT as BIAS
from rovid.effects.further_terms import trials_in_form
from rovid.effects.thruster_imbalance import thruster_of
from rovid.estimate.estimate import Estimate
from rovid.estimate.maximum_likelihood import fit_likelihood
from rovid.estimate.multi_step import MultiStepLikelihood
from rovid.model.model import Model
from rovid.model.parameter_names import base_names, effect_ids
from rovid.store.load import history_output, read_history, read_parameters
from rovid.store.parameter_file import Parameters, Source
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions, ConfigFingerprint
from rovid.trial.axis import PLANAR, Axis
from rovid.trial.preprocessing import Run, shared_channels
from rovid.trial.vehicle import Vehicle

# Probability from which both models include a suspected cause, because its absence would bias one of them.
_LIKELY = 0.5
# Most logs that a warning lists by name.
_NAMED = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class CampaignFit:
    """The results of one campaign."""

    name: str  # Name of the folder or file for messages
    axis: Axis
    vehicle_name: str  # Name of the vehicle in rovid.toml
    settings: ConfigFingerprint | None  # Fingerprint of rovid.toml; None if unknown
    sources: tuple[Source, ...]  # The logs with their digests
    stored_estimate: Estimate | None = None  # Content of a parameter file; None for logs
    # study, diagnosis: the logs and their diagnosis; None for a parameter file
    study: Study | None = None
    diagnosis: Diagnosis | None = None
    # For a parameter file: id of each cause that was tested and not found -> smallest detectable size
    detection_limits: Mapping[str, float] = field(default_factory=dict)

    @property
    def runs(self) -> Sequence[Run]:
        """Runs of the logs; none for a parameter file."""
        return () if self.study is None or self.study.runs is None else self.study.runs.items

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle; only for logs."""
        assert self.study is not None  # noqa: S101 - not called for a parameter file
        return self.study.vehicle

    @property
    def assumptions(self) -> Assumptions:
        """Guesses about the vehicle."""
        return Assumptions() if self.settings is None else self.settings.assumptions

    @cached_property
    def model(self) -> Model | None:
        """The final free-running model of the diagnosis, without campaign-specific effects; None without diagnosis."""
        if self.diagnosis is None or self.diagnosis.extended is None:
            return None
        return self.diagnosis.extended.model.with_effects(lambda effect: not _is_campaign_specific(effect))

    @property
    def found_effects(self) -> list[Effect]:
        """Established causes, or the effects in the parameter file."""
        if self.stored_estimate is not None:
            return list(map(effect_named, effect_ids(self.stored_estimate.names)))
        return [] if self.diagnosis is None else [finding.effect for finding in self.diagnosis.findings]

    @property
    def likely_findings(self) -> list[Finding]:
        """Established causes, and suspects that are more likely than not; all suspects of a diagnosis cut short."""
        if self.diagnosis is None:
            return []
        least = 0.0 if self.diagnosis.is_cut_short else _LIKELY
        suspects = [suspect for suspect in self.diagnosis.suspects if suspect.probability >= least]
        return [*self.diagnosis.findings, *suspects]

    @property
    def campaign_specific(self) -> list[Effect]:
        """Effects of its model that no other campaign can have: sizes of single trials, logged signals, waves."""
        if self.diagnosis is None or self.diagnosis.extended is None:
            return []
        return list(filter(_is_campaign_specific, self.diagnosis.extended.model.effects))

    def has_signals_for(self, effect: Effect) -> bool:
        """Whether its logs hold the signals that ``effect`` needs."""
        return set(effect.needs) <= set(shared_channels(self.runs))


@dataclass(frozen=True, kw_only=True, eq=False)
class SharedEstimate:
    """A campaign's estimate of the parameters that both campaigns share."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    # values, covariance: (p,) and (p, p), in the order of ``names``
    values: FloatArray
    covariance: FloatArray
    white: bool  # Whether the innovations are white
    samples: int
    warnings: tuple[str, ...] = ()

    def moments(self, name: str) -> tuple[float, float]:
        """Value and variance of a parameter; NaN if it is unknown."""
        if name not in self.names:
            return math.nan, math.nan
        index = self.names.index(name)
        return float(self.values[index]), float(self.covariance[index, index])


def campaign_from_study(study: Study, name: str) -> CampaignFit:
    """A campaign of logs without a diagnosis. Raises DataError if the study holds tables."""
    if study.runs is None:
        raise DataError("holds tables; logs, or a parameter file, were expected.", where=name, mend="Give logs.")
    provenance = study.provenance
    return CampaignFit(
        name=name,
        axis=study.vehicle.axis,
        vehicle_name=provenance.vehicle,
        settings=provenance.settings,
        sources=provenance.sources,
        study=study,
    )


def campaign_from_parameters(
    stored: Parameters, name: str, detection_limits: Mapping[str, float] | None = None
) -> CampaignFit:
    """A campaign from the content of a parameter file. Raises DataError if the inertia or the drag is missing."""
    names = [base for base in base_names(stored.axis) if base in stored.entries]
    if "quadratic_drag" not in names or ("inertia" not in names and not stored.per_inertia):
        text = "holds no inertia or no drag, which a comparison needs."
        raise DataError(text, where=name, mend="Run `rovid fit`.")
    names += [entry for entry in stored.entries if "." in entry]
    return CampaignFit(
        name=name,
        axis=stored.axis,
        vehicle_name=stored.vehicle,
        settings=stored.settings,
        sources=stored.sources,
        stored_estimate=stored.estimate(names),
        detection_limits=detection_limits or {},
    )


def campaign_from_file(path: Path, name: str) -> CampaignFit:
    """A campaign from a parameter file and its history. Raises RovidError if inertia or drag cannot be read."""
    stored = read_parameters(path)
    if stored.axis is PLANAR:
        mend = "Give --axes planar."
        raise ConfigError("holds the parameters of surge, sway and yaw together.", where=path, mend=mend)
    limits = (record.detection_limits for record in read_history(path) if _is_same_model(record.parameters, stored))
    return campaign_from_parameters(stored, name, next(limits, None))


def previous_campaign(stored: Parameters) -> CampaignFit:
    """The last model in the history of ``stored`` that was fitted to other logs, or else the last different model.

    Raises DataError if the history has no such model. Raises ConfigError if the history is damaged.
    """
    digests = frozenset(source.sha256 for source in stored.sources)
    records = list(read_history(stored.path))
    others = [record for record in records if record.digests != digests]
    others += [record for record in records if not _is_same_model(record.parameters, stored)]
    if not others:
        text = "holds no other model to compare with." if records else "there is no such history of earlier models."
        mend = "Give A and B. Each `rovid fit`, `rovid diagnose` and `rovid report` adds a line to the history."
        raise DataError(text, where=history_output(stored.path).path, mend=mend)
    found = others[0]
    logs = found.parameters.logs
    name = stored.path.name if logs == stored.logs else ", ".join(path.name for path in logs)
    return campaign_from_parameters(found.parameters, f"{name} as of {found.written[:16]}", found.detection_limits)


def _is_same_model(one: Parameters, other: Parameters) -> bool:
    """Whether both hold the same parameters of the same logs."""
    return one.entries == other.entries and one.sources == other.sources


def input_warnings(a: CampaignFit, b: CampaignFit) -> Iterator[str]:
    """Warnings on differences of the vehicles and on shared logs.

    Raises ConfigError if the axes or the thrusters differ.
    """
    if a.axis is not b.axis:
        text = f"is of {a.axis.name} and {b.name} of {b.axis.name}; one degree of freedom was expected."
        raise ConfigError(text, where=a.name, mend="Give --axis, or two parameter files of one axis.")
    if a.settings is not None and b.settings is not None:
        thrusters_a, thrusters_b = _thrusters(a.settings), _thrusters(b.settings)
        if thrusters_a != thrusters_b:
            raise ConfigError(
                f"has the thrusters {thrusters_a}, and {b.name} has {thrusters_b}. Parameters are measured relative to "
                "thrust, so vehicles with different thrusters cannot be compared.",
                where=a.name,
                mend="Compare campaigns with the same thrusters, and name them alike in both rovid.toml.",
            )
        differences = a.settings.changes(b.settings, drive_alone=True)
        if differences:
            words = f"rovid.toml differs: {'; '.join(differences)}. If that is a correction and not a refit, make both "
            yield (f"{words}files equal, because all parameters are measured relative to thrust.")
    if a.vehicle_name != b.vehicle_name:
        names = [repr(one.vehicle_name) if one.vehicle_name else "no name" for one in (a, b)]
        yield f"The names of the vehicles differ: {names[0]} in {a.name}, {names[1]} in {b.name}."
    shared = {source.sha256 for source in a.sources} & {source.sha256 for source in b.sources}
    if shared:
        names = [source.name for source in a.sources if source.sha256 in shared]
        logs = ", ".join(names) if len(names) <= _NAMED else f"{len(names)} logs ({names[0]} and others)"
        yield f"In both campaigns: {logs}. Results of the same logs are correlated, so the errors are not valid."


def _thrusters(settings: ConfigFingerprint) -> str:
    """Names of the thrusters, or of the logged torque."""
    drive = settings.drive.keys() - {"thrust_scale_error"}
    return ", ".join(sorted({name.partition(" of ")[2] or f"logged {name}" for name in drive})) or "nothing"


def with_diagnosis(
    campaign: CampaignFit, report: Callable[[str], None] = lambda _: None, budget: float | None = None
) -> CampaignFit:
    """``campaign`` with the diagnosis of its logs, within a ``budget`` in s.

    Raises DataError if the data do not suffice.
    """
    if campaign.study is None or campaign.diagnosis is not None:
        return campaign
    study = campaign.study
    seconds = study.default_budget if budget is None else budget
    diagnosis = study.diagnosis(lambda text: report(f"{campaign.name}: {text}"), budget=seconds)
    if diagnosis.extended is None:
        raise DataError(f"holds too few data for a comparison: {diagnosis.missing}", where=campaign.name)
    return replace(campaign, diagnosis=diagnosis)


def shared_estimate(campaign: CampaignFit, effects: Sequence[Effect]) -> SharedEstimate:
    """Estimate of inertia, drag and ``effects``: a joint fit for logs, the stored values for a parameter file.

    The fit includes a constant torque, because another trim of the day is no change of the vehicle. Its criterion is
    that of the diagnosis. Raises DataError if the excitation does not suffice.
    """
    if campaign.stored_estimate is not None:
        return _stored_estimate(campaign, campaign.stored_estimate, effects)
    fitted, diagnosis = (*campaign.campaign_specific, *effects), campaign.diagnosis
    if BIAS.id not in {effect.id for effect in fitted} and campaign.axis.name in BIAS.axes:
        fitted = (*fitted, BIAS)
    extended = None if diagnosis is None else diagnosis.extended
    by_predictions = extended is not None and extended.estimate.method == MultiStepLikelihood.method
    estimate, white = _of_diagnosis(diagnosis, fitted) if by_predictions else None, False
    if estimate is None:
        try:
            fit = fit_likelihood(campaign.runs, campaign.vehicle, fitted, by_predictions=by_predictions)
        except DataError as error:
            raise DataError(str(error), where=campaign.name) from error
        estimate, white = fit.estimate, fit.white
    shared = [f"{effect.key}.{parameter.name}" for effect in effects for parameter in effect.parameters]
    names = tuple(name for name in (*base_names(campaign.axis), *shared) if _is_known(estimate, name))
    indices = list(map(estimate.names.index, names))
    return SharedEstimate(
        names=names,
        units=tuple(map(estimate.unit, names)),
        values=estimate.values[indices],
        covariance=estimate.covariance[np.ix_(indices, indices)],
        white=white,
        samples=estimate.samples,
        warnings=estimate.warnings,
    )


def _of_diagnosis(diagnosis: Diagnosis | None, effects: Sequence[Effect]) -> Estimate | None:
    """Estimate of a ``diagnosis`` whose model has these ``effects`` and no others; None with suspects.

    The weights of predictions depend on the model before, and another fit has other ones. Errors with suspects include
    what these would change, which both campaigns share.
    """
    if diagnosis is None or diagnosis.extended is None or diagnosis.suspects:
        return None
    model = diagnosis.extended.model
    is_same = {effect.key for effect in model.effects} == {effect.key for effect in effects}
    return diagnosis.extended.estimate if is_same else None


def _is_known(estimate: Estimate, name: str) -> bool:
    return name in estimate.names and name not in estimate.refused


def _stored_estimate(campaign: CampaignFit, estimate: Estimate, effects: Sequence[Effect]) -> SharedEstimate:
    """Stored values; a cause that was tested and not found is zero, with half its detection limit as error."""
    names = [name for name in base_names(campaign.axis) if _is_known(estimate, name)]
    absent: dict[str, tuple[float, float]] = {}
    for effect in effects:
        limit = campaign.detection_limits.get(effect.id, math.nan)
        for parameter in effect.parameters:
            name = f"{effect.key}.{parameter.name}"
            if name in estimate.names:
                names.append(name)
            elif parameter is effect.parameters[0] and math.isfinite(limit):
                absent[name] = (parameter.neutral, 0.5 * limit)
    indices, count = list(map(estimate.names.index, names)), len(names)
    covariance = np.zeros((count + len(absent),) * 2)
    covariance[:count, :count] = estimate.covariance[np.ix_(indices, indices)]
    for index, (_, error) in enumerate(absent.values(), start=count):
        covariance[index, index] = error**2
    return SharedEstimate(
        names=(*names, *absent),
        units=tuple(map(estimate.unit, (*names, *absent))),
        values=np.array([*map(estimate.value, names), *(neutral for neutral, _ in absent.values())]),
        covariance=covariance,
        white=False,
        samples=sum(source.samples for source in campaign.sources),
    )


def shared_effects(a: CampaignFit, b: CampaignFit) -> list[Effect]:
    """Causes of either campaign that both models include, in the best form of each.

    Environmental causes are included too, because their absence would bias the other parameters.
    """
    if not a.runs or not b.runs:
        effects = (*a.found_effects, *b.found_effects)
        return list({effect.key: effect for effect in effects if not _is_campaign_specific(effect)}.values())
    best: dict[str, Finding] = {}
    for finding in (*a.likely_findings, *b.likely_findings):
        effect = finding.effect
        if _is_campaign_specific(effect) or not (a.has_signals_for(effect) and b.has_signals_for(effect)):
            continue
        thruster = thruster_of(effect.form) if effect.per_thruster else ""
        cause = f"{effect.id}:{thruster}"
        if cause not in best or finding.bic_gain > best[cause].bic_gain:
            best[cause] = finding
    strongest = [finding.effect for finding in sorted(best.values(), key=lambda finding: -finding.bic_gain)]
    # Equally weaker thrusters are not distinguishable from another scale of thrust, so one thruster stays unchanged.
    weak = [effect for effect in strongest if effect.per_thruster]
    dropped = weak[max(len(a.vehicle.thrusters) - 1, 1) :]
    return [effect for effect in strongest if effect not in dropped]


def _is_campaign_specific(effect: Effect) -> bool:
    return is_signal(effect) or bool(trials_in_form(effect.form)) or effect.is_wave or bool(effect.instants)
