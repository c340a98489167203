"""``rovid diagnose``."""

from dataclasses import replace
from pathlib import Path

from rovid.cli import sessions
from rovid.cli.context import compile_in_background, is_planar, prefetch_logs
from rovid.cli.options import add_effects
from rovid.cli.streams import progress


def diagnose(
    logs: list[Path] | None = None,
    *,
    axis: str | None = None,
    axes: str | None = None,
    parameters: Path | None = None,
    cutoff: float | None = None,
    budget: float | None = None,
    force: bool = False,
    effects_from: list[Path] | None = None,
    json: bool = False,
) -> None:
    """Find the errors of the simulation and their causes."""
    add_effects(effects_from)
    if is_planar(axes, axis, cutoff=cutoff):
        from rovid.present.documents.planar import planar_diagnosis_document
        from rovid.present.terminal.planar import show_planar_diagnosis

        coupled = sessions.open_planar_session(logs, parameters, force=force, require_sound=False)
        with progress("Diagnosing …", budget or coupled.study.logs.default_budget) as report:
            found = coupled.study.diagnosis(report, force=force, budget=budget)
        found = replace(found, warnings=(*found.warnings, *coupled.notes))
        stored = None
        if found.extended is not None:
            stored = sessions.store_planar_fit(coupled, found.extended.fit)
        sessions.print_result(found, coupled.study, stored, planar_diagnosis_document, show_planar_diagnosis, json=json)
        return
    with prefetch_logs(logs, parameters, axis, force=force) as prefetch:
        if compile_in_background():
            # The compilation already uses the second core.
            prefetch.stop()
        session = sessions.open_session(
            logs, parameters, axis, cutoff, force=force, with_history=True, require_sound=False, prefetch=prefetch
        )
    study = session.study
    with progress("Diagnosing …", budget or study.default_budget) as report:
        diagnosis = sessions.diagnose_study(session.stored, study, report, force=force, budget=budget)
    diagnosis = replace(diagnosis, warnings=(*diagnosis.warnings, *session.notes))
    stored = None
    if diagnosis.extended is not None:
        estimate, sizes = diagnosis.extended.estimate, diagnosis.detectable_sizes
        stored = sessions.store_estimate(session.stored, session.outputs, study, estimate, detectable_sizes=sizes)
    from rovid.present.documents.diagnosis import diagnosis_document
    from rovid.present.terminal.diagnosis import show_study_diagnosis

    sessions.print_result(diagnosis, study, stored, diagnosis_document, show_study_diagnosis, json=json)
