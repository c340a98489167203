"""``rovid diagnose``."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rovid.cli.context import (
    compile_in_background,
    console,
    diagnose_study,
    open_session,
    prefetch_logs,
    print_json,
    store_estimate,
)
from rovid.cli.options import (
    Axes,
    AxisName,
    Cutoff,
    EffectsFrom,
    Force,
    Json,
    OptionalLogs,
    ParameterFile,
    TimeBudget,
    add_effects,
)
from rovid.cli.planar_session import is_planar, open_planar_session, store_planar_fit
from rovid.cli.streams import progress


def diagnose(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    axes: Axes = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    budget: TimeBudget = None,
    force: Force = False,
    effects_from: EffectsFrom = None,
    json: Json = False,
) -> None:
    """Find the errors of the simulation and their causes."""
    add_effects(effects_from)
    if is_planar(axes, axis, cutoff=cutoff):
        _diagnose_planar(logs, parameters, budget, force=force, json=json)
        return
    with prefetch_logs(logs, parameters, axis, force=force) as prefetch:
        if compile_in_background():
            # The compilation already uses the second core.
            prefetch.stop()
        session = open_session(
            logs, parameters, axis, cutoff, force=force, with_history=True, require_sound=False, prefetch=prefetch
        )
    study = session.study
    with progress("Diagnosing …", budget or study.default_budget) as report:
        diagnosis = diagnose_study(session.stored, study, report, force=force, budget=budget)
    diagnosis = replace(diagnosis, warnings=(*diagnosis.warnings, *session.notes))
    if diagnosis.extended is not None:
        estimate, sizes = diagnosis.extended.estimate, diagnosis.detectable_sizes
        store_estimate(session.stored, session.outputs, study, estimate, detectable_sizes=sizes)
    if json:
        from rovid.present.documents.diagnosis import diagnosis_document

        print_json(diagnosis_document(diagnosis, study))
    else:
        from rovid.present.console import print_text
        from rovid.present.terminal.diagnosis import show_study_diagnosis

        show_study_diagnosis(console(), diagnosis, study)
        if diagnosis.extended is not None:
            print_text(console(), f"written to {session.stored.path}")


def _diagnose_planar(
    logs: Sequence[Path] | None, parameters: Path | None, budget: float | None, *, force: bool, json: bool
) -> None:
    """Diagnose surge, sway and yaw together."""
    from rovid.present.console import print_text
    from rovid.present.documents.planar import planar_diagnosis_document
    from rovid.present.terminal.planar import show_planar_diagnosis

    session = open_planar_session(logs, parameters, force=force, require_sound=False)
    study = session.study
    with progress("Diagnosing …", budget or study.logs.default_budget) as report:
        diagnosis = study.diagnosis(report, force=force, budget=budget)
    diagnosis = replace(diagnosis, warnings=(*diagnosis.warnings, *session.notes))
    if diagnosis.extended is not None:
        store_planar_fit(session, diagnosis.extended.fit)
    if json:
        print_json(planar_diagnosis_document(diagnosis, study))
        return
    show_planar_diagnosis(console(), diagnosis, study)
    if diagnosis.extended is not None:
        print_text(console(), f"written to {session.stored.path}")
