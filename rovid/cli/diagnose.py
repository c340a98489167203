"""``rovid diagnose``, ``rovid discover`` and ``rovid effect``."""

from dataclasses import replace
from pathlib import Path

from rovid.cli import context, sessions
from rovid.cli.options import SharedOptions
from rovid.cli.streams import progress
from rovid.core.errors import ConfigError, suggestion


def diagnose(logs: list[Path] | None = None, *, shared: SharedOptions) -> None:
    """Find the errors of the simulation and their causes."""
    force, budget = shared.force, shared.budget
    if context.is_planar(shared):
        coupled = sessions.open_planar_session(logs, shared, require_sound=False)
        with progress("Diagnosing …", budget or coupled.study.logs.default_budget) as report:
            found = coupled.study.diagnosis(report, force=force, budget=budget)
        found = replace(found, warnings=(*found.warnings, *coupled.notes))
        stored = None
        if found.extended is not None:
            stored = sessions.store_planar_fit(coupled, found.extended.fit)
        sessions.print_result(found, coupled.study, stored, json=shared.json)
        return
    with context.prefetch_logs(logs, shared) as prefetch:
        if context.compile_in_background():
            # The compilation already uses the second core.
            prefetch.stop()
        session = sessions.open_session(logs, shared, with_history=True, require_sound=False, prefetch=prefetch)
    study = session.study
    with progress("Diagnosing …", budget or study.default_budget) as report:
        diagnosis = sessions.diagnose_study(session.stored, study, report, force=force, budget=budget)
    diagnosis = replace(diagnosis, warnings=(*diagnosis.warnings, *session.notes))
    stored = None
    if diagnosis.extended is not None:
        estimate, sizes = diagnosis.extended.estimate, diagnosis.detectable_sizes
        stored = sessions.store_estimate(session.stored, session.outputs, study, estimate, detectable_sizes=sizes)
    sessions.print_result(diagnosis, study, stored, json=shared.json)


_ACTIONS = ("new", "try")


def effect(action: str, name: str, logs: list[Path] | None = None, *, shared: SharedOptions) -> None:
    """Write an effect of your own, or try it on logs."""
    if action not in _ACTIONS:
        raise ConfigError(f"is {action!r}. {suggestion(action, _ACTIONS)}", where="ACTION")
    if (action == "try") != bool(logs):
        text = "are missing: `rovid effect try FILE LOGS`." if action == "try" else "are only for `rovid effect try`."
        raise ConfigError(text, where="LOGS", mend="")
    if logs:
        context.compile_in_background()
        from rovid.core.budget import Budget
        from rovid.diagnose.effect_trial import try_effect
        from rovid.effects import load_plugins
        from rovid.effects.plugins import forms_of
        from rovid.present.documents.results import effect_trial_document
        from rovid.present.terminal.diagnosis import show_effect_trial

        load_plugins([Path(name)])
        forms = forms_of(Path(name))
        study = context.open_logs(logs, None, context.named_axis(shared.axis))
        if study.runs is None:
            raise ConfigError("are tables; an effect is tried on logs only.", where="LOGS", mend="Give logs.")
        study.require_effects(forms)
        study.require_sound()
        with progress("Fitting …") as report:
            found = try_effect(study.runs, study.vehicle, forms, Budget(seconds=study.default_budget, report=report))
        if shared.json:
            context.print_json(effect_trial_document(found, study.remarks()))
        else:
            show_effect_trial(context.console(), found, study.remarks())
    else:
        _write(name, shared)


def _write(name: str, shared: SharedOptions) -> None:
    """Write the files of a new effect."""
    from rovid.core.output_files import NEW_EFFECT, OutputFile, OutputSet
    from rovid.effects.catalogue import require_free_id
    from rovid.effects.plugins import new_files
    from rovid.present.console import print_path

    require_free_id(name)
    files = {OutputFile(Path(path), NEW_EFFECT): text for path, text in new_files(name).items()}
    OutputSet([*files], force=shared.force).write(files)
    paths = [str(file.path) for file in files]
    if shared.json:
        context.print_json({"schema": "rovid-effect/1", "effect": name, "files": paths, "warnings": []})
        return
    for path in paths:
        print_path(context.console(), f"written to {path}")
    print_path(context.console(), f"Test it: pytest {paths[1]}")
    print_path(context.console(), f"Try it: rovid effect try {paths[0]} LOGS")


def discover(logs: list[Path], *, write: Path | None = None, plot: Path | None = None, shared: SharedOptions) -> None:
    """Find a formula that predicts the unexplained torque."""
    context.compile_in_background()
    from rovid.core.budget import Budget
    from rovid.core.output_files import EFFECT_FILE, OutputFile, OutputSet, png_signature
    from rovid.diagnose.formulas.discovery import discover as find_formulas
    from rovid.effects.plugins import is_id
    from rovid.present.console import print_path, show_caution, show_warnings
    from rovid.present.documents.results import discovery_document
    from rovid.present.terminal.diagnosis import show_discovery
    from rovid.store.study import input_files

    if write is not None and not (is_id(write.stem) and write.suffix == ".py"):
        mend = "Use lower-case letters, digits and _, as in my_law.py."
        raise ConfigError("is no name of an effect's file.", where=write, mend=mend)
    files = {"effect": (write, EFFECT_FILE), "plot": (plot, png_signature("formula"))}
    wanted = {name: OutputFile(path, signature) for name, (path, signature) in files.items() if path is not None}
    outputs = OutputSet([*wanted.values()], force=shared.force, protected=input_files(logs))
    study = context.open_logs(logs, None, context.named_axis(shared.axis))
    if study.runs is None:
        raise ConfigError("are tables; a formula is found in logs only.", where="LOGS", mend="Give logs.")
    if not shared.force:
        study.require_sound()
    with progress("Discovering …") as report:
        found = find_formulas(study.runs, study.vehicle, report, Budget(seconds=shared.budget or study.default_budget))
    if found.formulas and wanted:
        from rovid.present.plots.canvas import render_png
        from rovid.present.plots.results import plot_formula

        best, contents = found.formulas[0], dict[OutputFile, str | bytes]()
        if write is not None:
            contents[wanted["effect"]] = found.source(best, write.stem, study.vehicle.axis.name)
        if plot is not None:
            contents[wanted["plot"]] = render_png(plot_formula(found, best, study.runs, study.vehicle), "formula")
        outputs.write(contents)
    warnings = [*study.remarks(), *found.warnings]
    written = {name: str(file.path) for name, file in wanted.items()} if found.formulas else {}
    if shared.json:
        context.print_json(discovery_document(found, warnings) | written)
        return
    show_caution(context.console(), study.vehicle.assumptions)
    show_discovery(context.console(), found)
    show_warnings(context.console(), warnings)
    for path in written.values():
        print_path(context.console(), f"written to {path}")
