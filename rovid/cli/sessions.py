"""A fit or a diagnosis by a command: open the parameter file and the logs, store the estimate, print the result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from rovid.cli import context
from rovid.cli.streams import progress

if TYPE_CHECKING:
    from rovid.cli.options import SharedOptions
    from rovid.core.output_files import OutputSet
    from rovid.diagnose.result import Diagnosis
    from rovid.estimate.estimate import Estimate
    from rovid.estimate.inertia import InertiaFit
    from rovid.estimate.maximum_likelihood import LikelihoodFit
    from rovid.estimate.steady_drag import DragFit
    from rovid.planar.fit import PlanarFit
    from rovid.readers.campaign import PrefetchedReader
    from rovid.store.parameter_file import Parameters
    from rovid.store.planar_study import PlanarStudy
    from rovid.store.study import Study

    Fit = TypeVar("Fit", DragFit, InertiaFit, LikelihoodFit)

AnyStudy = TypeVar("AnyStudy", "Study", "PlanarStudy")


@dataclass(frozen=True, kw_only=True)
class FitSession(Generic[AnyStudy]):
    """What a fit needs: the parameter file without stale values, the logs, the reserved files, and remarks."""

    stored: Parameters
    study: AnyStudy
    outputs: OutputSet
    notes: list[str]


def open_session(
    logs: Sequence[Path] | None,
    shared: SharedOptions,
    *,
    with_history: bool = False,
    require_sound: bool = True,
    prefetch: PrefetchedReader | None = None,
) -> FitSession[Study]:
    """Open the parameter file, reserve it (and its history), and read the logs.

    Logs with a fault that no fit survives raise a `LogError` if ``require_sound``, unless --force is given.
    """
    from rovid.trial.fault import FAULT_IDS, FaultOverrides

    stored = context.parameters_at(shared, force=shared.force)
    paths = logs or context.stored_logs(stored)
    outputs = _reserved(stored, paths, force=shared.force, with_history=with_history)
    study = context.open_logs(paths, shared.cutoff, stored.axis, prefetch)
    if shared.force:
        study = replace(study, overrides=FaultOverrides(kept=dict.fromkeys(FAULT_IDS, ("*",))))
    elif require_sound:
        from rovid.preflight.check import require_fittable
        from rovid.trial.config import find_config, load_config

        require_fittable(study, None if study.runs is None else load_config(find_config(paths), stored.axis))
    stored, notes = context.without_stale_values(stored, study)
    return FitSession(stored=stored, study=study, outputs=outputs, notes=notes)


def open_planar_session(
    logs: Sequence[Path] | None, shared: SharedOptions, *, require_sound: bool = True
) -> FitSession[PlanarStudy]:
    """`open_session` for surge, sway and yaw together."""
    stored, force = context.parameters_at(shared, planar=True, force=shared.force), shared.force
    paths = logs or context.stored_logs(stored)
    outputs = _reserved(stored, paths, force=force)
    study = context.open_planar_logs(paths)
    if require_sound and not force:
        study.logs.require_sound()
    stored, notes = context.without_stale_values(stored, study.logs)
    return FitSession(stored=stored, study=study, outputs=outputs, notes=notes)


def _reserved(stored: Parameters, logs: Sequence[Path], *, force: bool, with_history: bool = True) -> OutputSet:
    from rovid.store.load import history_output

    files = [stored.output, history_output(stored.path)] if with_history else [stored.output]
    return context.reserve_outputs(files, logs, force=force)


def fit_and_store(session: FitSession[Study], words: str, fit: Callable[[], Fit], *options: str, json: bool) -> None:
    """Run a fit, store its estimate in the parameter file, and print the result."""
    from rovid.store.checks import method_disagreement

    with progress(words):
        result: Fit = fit()
    study = session.study
    warnings = [*result.estimate.warnings, *session.notes]
    warnings += method_disagreement(session.stored.entries_for(study.paths), result.estimate)
    result = replace(result, estimate=replace(result.estimate, warnings=tuple(warnings)))
    stored = store_estimate(session.stored, session.outputs, study, result.estimate, *options)
    print_result(result, study, stored, json=json)


def print_result(result: object, study: Study | PlanarStudy, stored: Parameters | None, *, json: bool) -> None:
    """Print a fit or a diagnosis, and the parameter file it is ``stored`` in."""
    from rovid.api.records import PRINTED

    document, show = PRINTED[type(result)]
    if json:
        context.print_json(document(result, study))
        return
    from rovid.present.console import print_text

    show(context.console(), result, study)
    if stored is not None:
        print_text(context.console(), f"written to {stored.path}")


def diagnose_study(
    stored: Parameters, study: Study, report: Callable[[str], None], *, force: bool = False, budget: float | None = None
) -> Diagnosis:
    """Diagnose the logs and warn where ``stored`` disagrees; with ``force`` also logs with a fault that stops."""
    from rovid.diagnose.result import Diagnosis
    from rovid.preflight.check import reversed_thrusters
    from rovid.store.checks import method_disagreement

    if not force and (reversed_arms := reversed_thrusters(study)):
        return Diagnosis(verdict="bad_logs", missing=reversed_arms)
    stored, notes = context.without_stale_values(stored, study)
    seconds = budget or study.default_budget
    diagnosis = study.diagnosis(report, drag=stored.independent_drag(), force=force, budget=seconds)
    if diagnosis.extended is not None:
        notes = [*notes, *method_disagreement(stored.entries_for(study.paths), diagnosis.extended.estimate)]
    return replace(diagnosis, warnings=(*diagnosis.warnings, *notes))


def store_estimate(
    stored: Parameters,
    outputs: OutputSet,
    study: Study,
    estimate: Estimate,
    *options: str,
    detectable_sizes: Mapping[str, float] | None = None,
    with_history: bool = True,
) -> Parameters:
    """Store an estimate with its provenance in the parameter file, without values that are stale by now.

    A joint estimate of all parameters also goes into the history, with the effect sizes a diagnosis could detect.
    """
    from rovid.store.checks import JOINT_METHODS
    from rovid.store.load import update_parameters

    def change(current: Parameters) -> Parameters:
        fresh, _ = context.without_stale_values(current, study)
        provenance = study.provenance
        given = " ".join(filter(None, (provenance.options, *options)))
        return fresh.with_estimate(estimate, replace(provenance, options=given))

    limits = (detectable_sizes or {}) if with_history and estimate.method in JOINT_METHODS else None
    return update_parameters(stored, outputs, change, detection_limits=limits)


def store_planar_fit(session: FitSession[PlanarStudy], fit: PlanarFit) -> Parameters:
    """Store a fit of the coupled model in the parameter file, with a line in its history."""
    from rovid.store.load import update_parameters
    from rovid.store.planar_study import with_fit

    provenance = session.study.provenance
    return update_parameters(
        session.stored, session.outputs, lambda current: with_fit(current, fit, provenance), detection_limits={}
    )
