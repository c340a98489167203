"""A study of surge, sway and yaw together: the logs of a folder, and the coupled model of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rovid.core.budget import Budget, ProgressCallback
from rovid.core.errors import ConfigError, suggestion
from rovid.effects import FORMS, PLANAR_FORMS, Effect, effect_named
from rovid.effects.base import Actuating
from rovid.estimate.candidate_runs import RunLimits
from rovid.model.bound_effects import BoundEffect
from rovid.model.parameter_names import RUDDER_UNITS
from rovid.planar.dataset import PlanarData, planar_data
from rovid.planar.diagnosis import PlanarDiagnosis, diagnose_planar
from rovid.planar.effect_fits import planar_candidates
from rovid.planar.experiment import PlanarPlan, plan_planar
from rovid.planar.fit import PlanarFit, fit_all_readings, fit_planar
from rovid.planar.model import BASE_COUNT, PlanarModel, RudderModel
from rovid.planar.start_values import planar_rudders
from rovid.planar.trial_simulation import PlanarTrialSimulation, simulate_planar_trials
from rovid.readers import read_campaign
from rovid.store.parameter_file import OpenCombination, Parameters, Provenance
from rovid.store.planar_prior import planar_prior
from rovid.store.study import Study, study_of
from rovid.trial.config import Config, find_config, load_planar_config
from rovid.trial.fault import fault_texts, stopping
from rovid.trial.trial import Campaign
from rovid.trial.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarStudy:
    """A campaign of logs with its planar runs."""

    logs: Study  #: The same logs along yaw, with their faults and remarks.
    data: PlanarData

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle, with every actuator that acts on surge, sway or yaw."""
        return self.data.vehicle

    @property
    def provenance(self) -> Provenance:
        """Origin of an estimate from this study."""
        return replace(self.logs.provenance, options="")

    def remarks(self) -> list[str]:
        """Remarks on the logs, including everything that was dropped."""
        return self.logs.remarks()

    def fit(self, effects: Sequence[Effect] = ()) -> PlanarFit:
        """Fit of the coupled model with ``effects``; see `fit_planar`.

        Raises DataError if the logs do not excite the vehicle. Raises ConfigError if an effect needs a thruster or a
        signal that these logs do not have.
        """
        self._require_possible(effects)
        fit = fit_planar(self.data, effects)
        vehicle = self.vehicle
        return replace(fit, estimate=fit.estimate.with_assumptions(vehicle.assumptions, vehicle.relative_scale_error))

    def _require_possible(self, effects: Sequence[Effect]) -> None:
        known = {form.key for form in (*PLANAR_FORMS, *planar_candidates(self.data))}
        for effect in effects:
            if effect.key not in known:
                text = "needs a thruster or a signal that these logs do not have."
                raise ConfigError(text, where=effect.key, mend="Leave the effect out, or complete rovid.toml.")

    def plan(self, effects: Sequence[Effect], limits: RunLimits, narrow: str = "") -> PlanarPlan:
        """The next run, with `fit`'s model and `plan_planar`'s choice; each may raise what these do."""
        self._require_possible(effects)
        return plan_planar(self.data, fit_all_readings(self.data, effects), limits, narrow)

    def diagnosis(
        self, report: ProgressCallback = lambda _: None, *, force: bool = False, budget: float | None = None
    ) -> PlanarDiagnosis:
        """Errors of the coupled model and their causes.

        Raises DataError if the filter diverges next to the fitted model, so that no candidate can be tested.

        ``report``: Called with progress messages.
        ``force``: Diagnose logs with a fault that no fit survives, too.
        ``budget``: Time in s after which the diagnosis answers with what it has; None: the default of these logs.
        """
        faults = stopping(self.logs.faults)
        if faults and not force:
            return PlanarDiagnosis(verdict="bad_logs", missing=" ".join(fault_texts(faults)))
        seconds = self.logs.default_budget if budget is None else budget
        return diagnose_planar(self.data, report, Budget(seconds))

    def simulate(self, model: PlanarModel) -> list[PlanarTrialSimulation]:
        """Every run simulated freely by ``model``."""
        return simulate_planar_trials(model, self.data)

    def model(self, stored: Parameters) -> PlanarModel:
        """The model with the values of a parameter file. Raises ConfigError if a parameter is missing."""
        return planar_model(stored, planar_rudders(self.data))


def planar_model(stored: Parameters, rudders: Sequence[RudderModel] = ()) -> PlanarModel:
    """The model with the values of a parameter file, and ``rudders`` at their places.

    Raises ConfigError if a parameter is missing.
    """
    values = {name: entry.value for name, entry in stored.entries.items()} | dict(stored.assumed)
    effects = tuple(map(planar_effect, stored.effects))
    bound = tuple(BoundEffect(effect, np.zeros(len(effect.parameters))) for effect in effects)
    empty = PlanarModel(base=np.ones(BASE_COUNT), effects=bound, rudders=tuple(_stored(one, values) for one in rudders))
    for name in empty.names:
        if name not in values:
            mend = "Run `rovid fit --axes planar LOGS`."
            raise ConfigError(f"holds no {name}.", where=stored.path, mend=mend)
    return empty.with_values(np.array([values[name] for name in empty.names]))


def _stored(rudder: RudderModel, values: Mapping[str, float]) -> RudderModel:
    parts: dict[str, Any] = {
        part: values[name] for part in RUDDER_UNITS if (name := f"rudder.{rudder.name}.{part}") in values
    }
    return replace(rudder, **parts, stalls="stall" in parts)


def planar_effect(name: str) -> Effect:
    """The form of an effect in the coupled model; without a form the first one.

    Raises ConfigError if there is no such effect, or the coupled model does not have it.
    """
    for form in PLANAR_FORMS:
        if name in {form.key, form.id}:
            return form
    effect = effect_named(name)
    if not isinstance(effect.acts, Actuating):
        known = dict.fromkeys(form.id for form in PLANAR_FORMS)
        of_thrusters = dict.fromkeys(form.id for form in FORMS if isinstance(form.acts, Actuating))
        if effect.id == "sideslip_moment":
            mend = "Leave it out: the base model has the Munk moment, and sway_yaw_damping has N_v."
        else:
            mend = suggestion(name, [*known, *of_thrusters])
        raise ConfigError("is not an effect of the coupled model.", where=name, mend=mend)
    return effect


def open_combinations(fit: PlanarFit) -> tuple[OpenCombination, ...]:
    """What the logs do not determine: combinations, and parameters that have no influence on them, by reason."""
    found = [OpenCombination(combination=one.combination, text=one.text) for one in fit.undetermined]
    listed = {name for one in found for name in one.combination}
    for name, reason in fit.estimate.refused.items():
        if name not in listed and name in fit.estimate.names:
            found.append(OpenCombination(combination={name: 1.0}, text=f"{name}: {reason}."))
    return tuple(found)


def with_fit(stored: Parameters, fit: PlanarFit, provenance: Provenance | None = None) -> Parameters:
    """``stored`` with the parameters of ``fit`` in place of all earlier ones."""
    estimate = fit.estimate
    return replace(
        stored.with_estimate(estimate, provenance),
        undetermined=open_combinations(fit),
        assumed={name: estimate.value(name) for name in estimate.names if name in estimate.refused},
    )


def open_planar_study(paths: Sequence[Path], report: ProgressCallback = lambda _: None) -> PlanarStudy:
    """Read the logs in ``paths`` for surge, sway and yaw together; ``report`` is called with progress messages.

    Raises RovidError if the logs or rovid.toml cannot be read.
    """
    config = load_planar_config(find_config(paths))
    return planar_study_of(read_campaign(paths, config, report), config)


def planar_study_of(campaign: Campaign, config: Config) -> PlanarStudy:
    """The study of a ``campaign`` that was read with ``config``; see `open_planar_study`."""
    logs = study_of(campaign, config, planar=True)
    trials = () if logs.runs is None else tuple(run.trial for run in logs.runs.items)
    campaign = replace(campaign, trials=trials)
    data = replace(planar_data(campaign, logs.vehicle), prior=planar_prior(config))
    return PlanarStudy(logs=replace(logs, campaign=campaign), data=data)
