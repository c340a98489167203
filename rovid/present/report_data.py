"""The contents of a report, with every trial simulated by each nested model."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.control.design import ControllerDesign
from rovid.core.threads import thread_map
from rovid.diagnose.cross_validation import split_runs
from rovid.diagnose.result import Diagnosis, ModelAssessment
from rovid.diagnose.signal_regressors import is_signal
from rovid.effects import Effect
from rovid.effects.further_terms import trials_in_form
from rovid.estimate.assumed_models import SizedCause
from rovid.estimate.inertia import InertiaFit
from rovid.estimate.isolability import PairSeparation, expected_separations
from rovid.estimate.steady_drag import DragFit
from rovid.export.verification import VerifiedExport
from rovid.model.model import Model
from rovid.model.simulation import TrialSimulation, simulate_runs
from rovid.store.parameter_file import Parameters
from rovid.store.study import Study
from rovid.trial.axis import Axis
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import PreparedRuns
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

# Causes, and rivals of each, between which the expected evidence is computed: one fit for each.
_CAUSES_COMPARED, _RIVALS_COMPARED = 4, 3


@dataclass(frozen=True, kw_only=True, eq=False)
class NestedSimulation:
    """A model, and every trial simulated with it."""

    model: Model
    simulations: tuple[TrialSimulation, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportData:
    """Results of a study; a refusal states why a result is missing."""

    vehicle: Vehicle
    #: ``parameters``, ``simulations``: of the report's model.
    parameters: Parameters
    #: ``campaign``, ``runs``: none where tables replace logs.
    campaign: Campaign | None
    runs: PreparedRuns | None
    drag: DragFit | None
    drag_refusal: str
    inertia: InertiaFit | None
    inertia_refusal: str
    simulations: tuple[TrialSimulation, ...]
    #: Every trial simulated without causes first, and with all causes, the report's model, last; empty without a
    #: diagnosis of logs.
    nested: tuple[NestedSimulation, ...] = ()
    separations: tuple[PairSeparation, ...] = ()  #: Expected evidence of the logs between causes and their rivals.
    #: ``diagnosis``, ``control``, ``exports``: none without a refusal where they were not requested; controller and
    #: exports exist for yaw only.
    diagnosis: Diagnosis | None = None
    diagnosis_refusal: str = ""
    control: ControllerDesign | None = None
    control_refusal: str = ""
    exports: Mapping[str, VerifiedExport] | None = None
    export_refusal: str = ""
    faults: tuple[Fault, ...] = ()  #: Faults of the logs, those that stop a fit first.
    notes: tuple[str, ...] = ()  #: Sentences on the state of the parameter file.

    @property
    def axis(self) -> Axis:
        """The axis of the report."""
        return self.vehicle.axis

    @property
    def trials(self) -> tuple[Trial, ...]:
        """All trials; none where tables replace logs."""
        return self.campaign.trials if self.campaign else ()

    @property
    def simulations_without(self) -> tuple[TrialSimulation, ...]:
        """Every trial simulated without the causes; by the report's model where there is no diagnosis."""
        return self.nested[0].simulations if self.nested else self.simulations

    @property
    def simulations_with(self) -> tuple[TrialSimulation, ...]:
        """Every trial simulated with all causes."""
        return self.nested[-1].simulations if self.nested else self.simulations

    @property
    def extended(self) -> ModelAssessment | None:
        """The model with the causes; None where there are none."""
        if self.diagnosis is None or self.diagnosis.extended is None or not self.diagnosis.extended.model.effects:
            return None
        return self.diagnosis.extended

    @property
    def steady_drag_model(self) -> Model | None:
        """Model of the torque in steady states, without inertia; None where the drag is not known."""
        values = {name: entry.value for name, entry in self.parameters.entries.items()}
        if "quadratic_drag" not in values or self.parameters.per_inertia:
            return None
        buoyancy = values.get("net_buoyancy")
        return Model(
            inertia=math.nan,
            quadratic_drag=values["quadratic_drag"],
            linear_drag=values.get("linear_drag", 0.0),
            axis=self.axis,
            restoring_values=() if buoyancy is None else (buoyancy,),
        )


def simulate_nested_models(study: Study, diagnosis: Diagnosis) -> tuple[NestedSimulation, ...]:
    """Every trial simulated by the base model, the models between, and the extended model.

    The base model alone where no cause was found. Trials whose parts were diagnosed separately, each with its own
    response to a signal, are simulated in these parts.
    """
    base, extended = diagnosis.base, diagnosis.extended
    if study.runs is None or base is None or extended is None:
        return ()
    runs, models = study.runs, [base.model]
    if extended.model.effects:
        models += [*diagnosis.nested_models, extended.model]
    if any(map(is_signal, extended.model.effects)):
        runs = split_runs(runs.items, study.vehicle, runs.cutoff) or runs

    def simulated(model: Model) -> NestedSimulation:
        return NestedSimulation(model=model, simulations=tuple(simulate_runs(runs.items, model, study.vehicle)))

    return tuple(thread_map(simulated, models))


def separations(study: Study, diagnosis: Diagnosis) -> tuple[PairSeparation, ...]:
    """Expected evidence of the logs between each cause and its nearest rivals; empty where there is none."""
    if diagnosis.fitted is None or study.runs is None or not study.vehicle.thrusters:
        return ()
    causes = []
    for finding in diagnosis.causes[:_CAUSES_COMPARED]:
        effects = [one.effect for one in finding.alternatives]
        others = [one for one in effects if not (one.is_wave or is_signal(one) or trials_in_form(one.form))]
        if others and not finding.effect.is_wave:
            cause = SizedCause(effect=finding.effect, values=finding.estimate.values)
            causes.append((cause, others[:_RIVALS_COMPARED]))
    trials = [run.trial for run in study.runs.items]
    return tuple(expected_separations(diagnosis.fitted, causes, study.vehicle, trials))


def effects_of(nested: Sequence[NestedSimulation]) -> tuple[Effect, ...]:
    """Effects that a simulation shows, in the order of the models; waves, which have no known phase, are left out."""
    effects: dict[str, Effect] = {}
    for simulation in nested:
        for effect in simulation.model.effects:
            if not effect.is_wave:
                effects.setdefault(effect.key, effect)
    return tuple(effects.values())


def worst_first(simulations: Sequence[TrialSimulation]) -> list[int]:
    """Indices of the trials by decreasing RMS error of the rate; trials without an error last."""
    errors = np.array([item.fit.rmse for item in simulations])
    errors[~np.isfinite(errors)] = -1.0
    order: list[int] = np.argsort(-errors, kind="stable").tolist()
    return order
