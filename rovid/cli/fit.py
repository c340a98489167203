"""Estimation: all commands ``rovid fit…``, ``rovid diagnose``, ``rovid discover`` and ``rovid effect``."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rovid.cli import context, sessions
from rovid.cli.options import SharedOptions
from rovid.cli.streams import progress
from rovid.core.errors import ConfigError, suggestion

if TYPE_CHECKING:
    from rovid.cli.sessions import FitSession
    from rovid.estimate.thrust_curve import ThrustScale
    from rovid.store.parameter_file import Parameters
    from rovid.store.study import Study


def fit_drag(logs: list[Path], *, shared: SharedOptions) -> None:
    """Fit drag from steady turns."""
    from rovid.preflight.check import drag_without_feedback

    session = sessions.open_session(logs, shared)
    if session.stored.axis.self_righting:
        # Under a constant torque such an axis comes to rest, so drag is found together with the inertia.
        _fit_inertia(session, json=shared.json)
        return
    sessions.fit_and_store(session, "Fitting drag …", partial(drag_without_feedback, session.study), json=shared.json)


def fit_inertia(logs: list[Path] | None = None, *, shared: SharedOptions) -> None:
    """Fit inertia from sines by four methods."""
    _fit_inertia(sessions.open_session(logs, shared), json=shared.json)


def _fit_inertia(session: FitSession[Study], *, json: bool) -> None:
    drag = session.stored.independent_drag()
    sessions.fit_and_store(session, "Fitting inertia …", lambda: session.study.inertia(drag), json=json)


def fit(
    logs: list[Path] | None = None, *, effect: list[str] | None = None, gyro: bool = False, shared: SharedOptions
) -> None:
    """Fit all parameters by maximum likelihood."""
    names = list(dict.fromkeys(effect or ()))
    if context.is_planar(shared, gyro=gyro):
        from rovid.store.planar_study import planar_effect

        chosen = tuple(dict.fromkeys(map(planar_effect, names)))
        coupled = sessions.open_planar_session(logs, shared)
        with progress("Fitting surge, sway and yaw …"):
            result = coupled.study.fit(chosen)
        warnings = (*result.estimate.warnings, *coupled.notes)
        result = replace(result, estimate=replace(result.estimate, warnings=warnings))
        stored = sessions.store_planar_fit(coupled, result)
        sessions.print_result(result, coupled.study, stored, json=shared.json)
        return
    context.compile_in_background()
    from rovid.effects import effect_named

    effects = tuple(map(effect_named, names))
    session = sessions.open_session(logs, shared, with_history=True)
    text, options = "Maximising the likelihood …", ["--gyro"] * gyro
    maximise = partial(session.study.likelihood, effects, gyro=gyro)
    sessions.fit_and_store(session, text, maximise, *options, json=shared.json)


def fit_thruster(
    bench: Path,
    *,
    output: Path | None = None,
    command: str | None = None,
    thrust: str | None = None,
    unit: str | None = None,
    force: bool = False,
    json: bool = False,
) -> None:
    """Fit a thrust curve to bench measurements."""
    from rovid.core.output_files import CURVE, OutputFile, OutputSet
    from rovid.estimate.thrust_curve import THRUST_UNITS, bench_readings, fit_thrust_curve
    from rovid.present.documents.fits import bench_document
    from rovid.present.terminal.results import show_bench
    from rovid.trial.tables import CURVE_COLUMNS, curve_csv, read_table

    if unit is not None and unit not in THRUST_UNITS:
        synonyms = {"newton": "N", "kilonewton": "kN", "kg": "kgf", "g": "gf", "lb": "lbf", "pound": "lbf"}
        raise ConfigError(f"is {unit!r}. {suggestion(unit, THRUST_UNITS, synonyms)}", where="--unit")
    curve = OutputFile(output or Path(f"{bench.stem}_curve.csv"), CURVE)
    outputs = OutputSet([curve], force=force, protected=[bench])
    table = read_table(bench, headerless=CURVE_COLUMNS)
    result = fit_thrust_curve(*bench_readings(table, command=command, thrust=thrust, unit=unit))
    outputs.write({curve: curve_csv(result.curve.command, result.curve.thrust)})
    context.print_either(bench_document(result, str(curve.path)), show_bench, result, curve.path, json=json)


def fit_thrust_scale(
    tests: Path | None = None,
    *,
    before: Path | None = None,
    after: Path | None = None,
    added: float | None = None,
    reference_error: float = 1.0,
    json: bool = False,
) -> None:
    """Estimate the common scale of all thrust from a pull, a lift or a step of inertia."""
    from rovid.estimate.thrust_curve import scale_from_step
    from rovid.present.documents.fits import thrust_scale_document
    from rovid.present.terminal.results import show_thrust_scale

    given = 1.0
    if tests is not None and before is None and after is None and added is None:
        scale, given = _of_tests(tests, reference_error / 100.0)
    elif tests is None and before is not None and after is not None and added is not None:
        files = [context.existing_parameters(SharedOptions(parameters=path)) for path in (before, after)]
        given, pairs = _common_scale(*files), []
        for path, stored in zip((before, after), files, strict=True):
            if "inertia" not in stored.entries:
                raise ConfigError("holds no inertia.", where=path, mend="Run `rovid fit` with -p for this file.")
            pairs.append((stored.entries["inertia"].value, stored.entries["inertia"].standard_error))
        scale = scale_from_step(pairs[0], pairs[1], added, reference_error / 100.0)
    else:
        text = "TESTS, or --before, --after and --added together, were expected."
        raise ConfigError(text, where="rovid fit-thrust-scale", mend="See `rovid fit-thrust-scale --help`.")
    context.print_either(thrust_scale_document(scale, given), show_thrust_scale, scale, given, json=json)


def _common_scale(before: Parameters, after: Parameters) -> float:
    """The scale of the thrust that both files rest on. Raises ConfigError if their thrusts differ."""
    if before.settings is None or after.settings is None:
        return 1.0
    if differences := before.settings.changes(after.settings, drive_alone=True):
        text = f"rests on another thrust than {before.path}: {'; '.join(differences)}."
        mend = "Fit both with the same thrusters and thrust_scale in rovid.toml."
        raise ConfigError(text, where=after.path, mend=mend)
    if "thrust_scale_error" not in after.settings.drive:
        return 1.0
    from rovid.trial.config import find_config, load_config

    return load_config(find_config(after.logs)).vehicle.thrust_scale


def _of_tests(path: Path, reference_error: float) -> tuple[ThrustScale, float]:
    """The scale by a table of pulls or lifts, and the scale that rovid.toml has already."""
    import numpy as np

    from rovid.estimate.thrust_curve import scale_from_lifts, scale_from_pulls
    from rovid.trial.config import find_config, load_config_of_any_axis
    from rovid.trial.tables import PULL_COLUMNS, read_table

    config, table = load_config_of_any_axis(find_config([path])), read_table(path)
    vehicle = config.vehicle
    acting = []
    for thruster, signal in zip(vehicle.thrusters, config.commands, strict=True):
        names = [name for name in (signal.sources.get("csv", ""), thruster.name) if name in table.header]
        if thruster.curve is not None and names:
            acting.append((thruster, thruster.curve, names[0]))
    measured = [name for name in PULL_COLUMNS if name in table.header]
    if len(measured) != 1 or not acting:
        wanted = [signal.sources.get("csv", signal.name) for signal in config.commands]
        text = f"has the columns {', '.join(table.header)}; one of force_N, weight_N and torque_Nm, and commands "
        text += f"({', '.join(wanted)}) were expected."
        raise ConfigError(text, where=path, mend=suggestion(measured[0] if measured else "force_N", table.header))
    if (in_torque := measured[0] == "torque_Nm") and not config.axis.angular:
        text = f"torque_Nm is no force, and rovid.toml describes {config.axis.name}."
        raise ConfigError(text, where=path, mend="Give force_N or weight_N.")
    # A force is along the axis of a vehicle that moves along one, else along the thrusters.
    along = in_torque or not config.axis.angular
    thrust = np.zeros(len(table.rows))
    for thruster, curve, name in acting:
        command = table.numbers(name)
        if curve.excess(command):
            low, high = curve.command[[0, -1]]
            text = f"{name} leaves the curve of {thruster.name}, which ends at {low:g} and {high:g}."
            raise ConfigError(text, where=path, mend="Delete these rows, or extend the curve.")
        thrust += (thruster.arm if along else 1.0) * curve(command)
    fit = scale_from_lifts if measured[0] == "weight_N" else scale_from_pulls
    return fit(thrust, table.numbers(measured[0]), reference_error), vehicle.thrust_scale


def diagnose(logs: list[Path] | None = None, *, shared: SharedOptions) -> None:
    """Find the errors of the simulation and their causes."""
    force, budget = shared.force, shared.budget
    if context.is_planar(shared):
        coupled = sessions.open_planar_session(logs, shared, require_sound=False)
        with progress("Diagnosing …", budget or coupled.study.logs.default_budget) as report:
            found = coupled.study.diagnosis(report, force=force, budget=budget)
        found = replace(found, warnings=(*found.warnings, *coupled.notes))
        stored = None if found.extended is None else sessions.store_planar_fit(coupled, found.extended.fit)
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
        document = effect_trial_document(found, study.remarks())
        context.print_either(document, show_effect_trial, found, study.remarks(), json=shared.json)
    else:
        _write_effect(name, shared)


def _write_effect(name: str, shared: SharedOptions) -> None:
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
    document, guess = discovery_document(found, warnings) | written, study.vehicle.assumptions
    context.print_either(document, show_discovery, found, guess, warnings, written.values(), json=shared.json)
