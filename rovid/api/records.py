"""Records from the results of the commands, along one axis and of surge, sway and yaw together."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console

from rovid.api import results as to
from rovid.compare.comparison import Comparison
from rovid.core.errors import ConfigError, DataError, shortened_list
from rovid.diagnose.result import Diagnosis, Finding, ModelAssessment
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import ExperimentPlan, command_csv
from rovid.estimate.inertia import InertiaFit
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.estimate.steady_drag import DragFit
from rovid.export.verification import VerifiedExport
from rovid.model.parameter_names import effect_ids
from rovid.model.simulation import TrialSimulation, simulate_runs
from rovid.planar.diagnosis import PlanarAssessment, PlanarDiagnosis
from rovid.planar.fit import PlanarFit
from rovid.planar.standard_manoeuvres import run_manoeuvres
from rovid.planar.trial_simulation import PlanarTrialSimulation
from rovid.preflight.check import LogCheck
from rovid.preflight.planar_check import PlanarCheck
from rovid.present.console import show_caution, show_faults, show_warnings
from rovid.present.documents import diagnosis as diagnoses
from rovid.present.documents import fits, results
from rovid.present.tables.trials import simulation_table
from rovid.present.terminal import check as show_checks
from rovid.present.terminal import diagnosis as show_diagnoses
from rovid.present.terminal import results as show_results
from rovid.store.parameter_file import Parameters
from rovid.store.planar_study import PlanarStudy, with_fit
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import PLANAR
from rovid.trial.fault import fault_texts
from rovid.trial.trial import NO_FILE
from rovid.trial.vehicle import Vehicle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

# Type of a result -> the document that its command prints with --json, and what it prints without.
PRINTED: Mapping[type, tuple[Callable[..., dict[str, Any]], Callable[..., None]]] = {
    LogCheck: (results.check_document, show_checks.show_check),
    PlanarCheck: (results.planar_check_document, show_checks.show_check),
    **dict.fromkeys((DragFit, InertiaFit, LikelihoodFit), (fits.fit_document, show_results.show_fit)),
    PlanarFit: (fits.planar_fit_document, show_results.show_planar_fit),
    Diagnosis: (diagnoses.diagnosis_document, show_diagnoses.show_study_diagnosis),
    PlanarDiagnosis: (diagnoses.planar_diagnosis_document, show_diagnoses.show_planar_diagnosis),
}
_CAUSE_KEYS = ["effect", "evidence", "confidence", "log_likelihood_gain", "held_out_log_likelihood_gain"]


def check_record(found: LogCheck | PlanarCheck, vehicle: Vehicle) -> to.CheckRecord:
    """The record of a check."""
    document_of, show_of = PRINTED[type(found)]
    document = document_of(found, vehicle)

    def show(console: Console) -> None:
        show_caution(console, vehicle.assumptions)
        show_of(console, found)

    def draw(panel: Axes) -> None:
        name, unit = vehicle.axis.position_words, vehicle.axis.display_unit
        for trial in found.trials:
            panel.plot(trial.time, trial.position * unit[1], label=trial.name)
        _label(panel, "time, s", f"{name}, {unit[0]}")

    return to.CheckRecord(
        document=document,
        show=show,
        draw=draw,
        table=lambda: _frame(document["logs"]).drop(columns="remarks", errors="ignore"),
        verdict=found.verdict,
        faults=found.faults,
    )


def fit_record(fit: LikelihoodFit | PlanarFit, study: Study | PlanarStudy) -> to.ModelRecord:
    """The record of a fit."""
    document_of, show_of = PRINTED[type(fit)]
    document, stored = document_of(fit, study), _stored(fit, study)
    return to.ModelRecord(
        show=lambda console: show_of(console, fit, study),
        draw=lambda panel: simulation_record(stored, study).draw(panel),
        table=lambda: _by_parameter(document["parameters"]),
        **_model(document, fit.estimate, stored),
        faults=_logs(study).faults,
    )


def simulation_record(
    stored: Parameters, study: Study | PlanarStudy, remarks: Sequence[str] = (), guess: Assumptions | None = None
) -> to.SimulationRecord:
    """The record of a free-running simulation with the parameters ``stored``.

    ``remarks``: Further remarks, on the parameters.
    ``guess``: Assumptions that the parameters depend on; None: those about the vehicle.
    """
    logs, guess = _logs(study), study.vehicle.assumptions if guess is None else guess
    notes = [*study.remarks(), *remarks]
    warnings = [*fault_texts(logs.faults), *notes]
    runs: Sequence[TrialSimulation | PlanarTrialSimulation]
    if isinstance(study, PlanarStudy):
        coupled = study.model(stored)
        runs = coupled_runs = study.simulate(coupled)
        _require_finite(runs, stored, study)
        found = run_manoeuvres(coupled, study.data)
        document = results.planar_simulation_document(stored, coupled_runs, warnings, guess, found)
    elif logs.runs is None:
        raise DataError("are tables; only logs can be simulated.", where="LOGS", mend="Give LOGS.")
    else:
        model = stored.model()
        study.require_effects(model.effects)
        runs = single_runs = simulate_runs(logs.runs.items, model, logs.vehicle)
        _require_finite(runs, stored, study)
        document = results.simulation_document(stored, single_runs, warnings, guess) | {"recordings": []}

    def show(console: Console) -> None:
        if isinstance(study, PlanarStudy):
            show_results.show_planar_simulation(console, coupled_runs, guess, warnings)
            return
        show_caution(console, guess)
        show_faults(console, logs.faults)
        simulation_table(single_runs).print(console, guess)
        show_warnings(console, notes)

    def draw(panel: Axes) -> None:
        from rovid.present.plots.canvas import plot_overlay

        axis, place = logs.vehicle.axis, int(np.argmax([one.run.trial.duration for one in runs]))
        longest = runs[place]
        if isinstance(longest, TrialSimulation):
            time, measured = longest.run.rates.time, longest.measured
            simulated, fit = longest.simulated, longest.fit
        else:
            read = longest.measured[axis.rate_signal]
            time, measured = read.time, read.values  # noqa: PD011 - no DataFrame
            simulated, fit = longest.simulated[axis.rate_signal], longest.fits[axis.rate_signal]
        plot_overlay(panel, time, measured, simulated)
        panel.set_title(f"{longest.run.trial.name}   R² {fit.r2:.4f}")
        _label(panel, "time, s", f"{axis.rate_words}, {axis.rate_unit}")

    return to.SimulationRecord(
        document=document,
        show=show,
        draw=draw,
        table=lambda: _frame(document["trials"]),
        simulations=runs,
        r2={key.removesuffix("_r2"): value for key, value in document["overall"].items() if key.endswith("_r2")},
    )


def _require_finite(
    runs: Sequence[TrialSimulation | PlanarTrialSimulation], stored: Parameters, study: Study | PlanarStudy
) -> None:
    """Raises ConfigError, with the unusual values, if a simulation with the parameters ``stored`` has no numbers."""
    failed = [
        one.run.trial.name
        for one in runs
        if not np.isfinite(one.position if isinstance(one, TrialSimulation) else one.motion.through_water).all()
    ]
    if failed:
        unusual = " ".join(study.unusual_values(stored)) or "No single value is unusual for these logs."
        text = f"gives no finite simulation of {shortened_list(failed)}. {unusual}"
        raise ConfigError(text, where=stored.path, mend="Look for a wrong digit, or fit again: `rovid fit`.")


def diagnosis_record(found: Diagnosis | PlanarDiagnosis, study: Study | PlanarStudy) -> to.DiagnosisRecord:
    """The record of a diagnosis."""
    document_of, show_of = PRINTED[type(found)]
    document, logs = document_of(found, study), _logs(study)
    axis = logs.vehicle.axis
    side = found.extended or found.base
    final = side.fit if isinstance(side, PlanarAssessment) else side

    def draw(panel: Axes) -> None:
        if not document["horizons"]:
            text = f"the diagnosis has no prediction errors to plot: its verdict is {found.verdict}."
            raise DataError(text, mend="Print the diagnosis: it names what is missing.")
        errors, unit = _frame(document["horizons"]), axis.display_unit[0]
        for name, dashes in (("base", "--"), ("extended", "-")):
            panel.plot(errors["seconds"], errors[f"{name}_{unit}"], dashes, marker="o", label=f"{name} model")
        _label(panel, "time after a restart, s", f"{axis.position_words} error (RMS), {unit}")

    kinds = ("findings", "suspects")
    rows = [{"kind": kind} | {key: one[key] for key in _CAUSE_KEYS} for kind in kinds for one in document[kind]]
    return to.DiagnosisRecord(
        show=lambda console: show_of(console, found, study),
        draw=draw,
        table=lambda: _frame(rows, ["kind", *_CAUSE_KEYS]),
        **_model(document, None if final is None else final.estimate, _stored(final, study)),
        faults=tuple(diagnoses.all_faults(found, logs) if isinstance(found, Diagnosis) else logs.faults),
        verdict=found.verdict,
        findings=tuple(map(_cause_record, found.findings)),
        suspects=tuple(map(_cause_record, found.suspects)),
    )


def _cause_record(finding: Finding) -> to.CauseRecord:
    from rovid.present.plots.results import draw_alternatives

    document = diagnoses.finding_document(finding)
    return to.CauseRecord(
        document=document,
        show=lambda console: show_diagnoses.show_finding(console, finding),
        draw=lambda panel: draw_alternatives(panel, finding),
        table=lambda: _by_parameter(document["parameters"]),
        effect=finding.effect.id,
        parameters={name.rpartition(".")[2]: value for name, value in _values(finding.estimate).items()},
        confidence=finding.probability,
        evidence=str(finding.evidence),
        cannot_be_told_from=tuple(document["cannot_be_told_from"]),
    )


def plan_record(plan: ExperimentPlan, vehicle: Vehicle) -> to.PlanRecord:
    """The record of a plan."""
    import pandas as pd

    def draw(panel: Axes) -> None:
        from rovid.present.plots.results import draw_commands

        draw_commands(panel, plan)
        panel.set_title(plan.best.run.name)
        _label(panel, "time, s", "command")

    document = results.plan_document(plan, vehicle, "", "", ()) | {"command_file": None, "picture": None}
    return to.PlanRecord(
        document=document,
        show=lambda console: show_results.show_plan(console, plan, (), vehicle.assumptions, ()),
        draw=draw,
        table=lambda: _frame(document["runs"]),
        decides=plan.is_decisive,
        commands=pd.read_csv(io.StringIO(command_csv(plan)), comment="#"),
    )


def comparison_record(comparison: Comparison) -> to.ComparisonRecord:
    """The record of a comparison."""

    def draw(panel: Axes) -> None:
        from rovid.present.plots.results import draw_ratios

        changes = comparison.changes
        draw_ratios(panel, changes, {name: name.replace("_", " ") for name in changes.pair.names})

    guess = comparison.a.assumptions | comparison.b.assumptions
    document = diagnoses.comparison_document(comparison, guess, ())
    keys = ("ratio", "standard_error", "confidence")
    rows = {
        name: {side: both[side]["value"] for side in "ab"} | {key: both[key] for key in keys}
        for name, both in document["parameters"].items()
    }
    return to.ComparisonRecord(
        document=document,
        show=lambda console: show_diagnoses.show_comparison(console, comparison, guess, ()),
        draw=draw,
        table=lambda: _by_parameter(rows),
        verdict=comparison.verdict,
        changed=tuple(document["changed"]),
    )


def export_record(name: str, made: VerifiedExport, vehicle: Vehicle) -> to.ExportRecord:
    """The record of an export in the format ``name``."""
    document = results.export_document(name, "", made, vehicle.assumptions) | {"file": None}

    def draw(panel: Axes) -> None:
        parts = {one["what"]: one for one in document["not_held"]} | {"the file as a whole": document["mismatch"]}
        panel.barh(list(parts), [one["yaw_rate_percent_of_range"] for one in parts.values()])
        _label(panel, "error of the yaw rate, % of its range", "")

    percentages = [key for key in document["mismatch"] if key.endswith("percent_of_range")]
    return to.ExportRecord(
        document=document,
        show=lambda console: show_results.show_export(console, Path(name), made, vehicle.assumptions),
        draw=draw,
        table=lambda: _frame(document["not_held"], ["what", "why", *percentages]),
        format=name,
        content=made.content,
        not_held=tuple(loss.what for loss in made.losses),
    )


# --- shared parts -------------------------------------------------------------------------------------------------


def _model(document: dict[str, Any], estimate: Estimate | None, stored: Parameters) -> dict[str, Any]:
    """Fields that a fit and a diagnosis share."""
    return {
        "document": document,
        "parameters": {} if estimate is None else _values(estimate),
        "effects": () if estimate is None else tuple(key.partition(":")[0] for key in effect_ids(estimate.names)),
        "warnings": tuple(document["warnings"]),
        "estimate": estimate,
        "stored": stored,
    }


def _logs(study: Study | PlanarStudy) -> Study:
    return study.logs if isinstance(study, PlanarStudy) else study


def _stored(fit: LikelihoodFit | ModelAssessment | PlanarFit | None, study: Study | PlanarStudy) -> Parameters:
    """The model as a parameter file would hold it."""
    axis = PLANAR if isinstance(study, PlanarStudy) else study.vehicle.axis
    empty = Parameters(path=NO_FILE, vehicle=study.vehicle.name, axis=axis)
    if fit is None:
        return empty
    return with_fit(empty, fit) if isinstance(fit, PlanarFit) else empty.with_estimate(fit.estimate)


def _frame(rows: Sequence[Mapping[str, Any]], columns: list[str] | None = None) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(rows, columns=columns)


def _by_parameter(values: Mapping[str, Any]) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame.from_dict(dict(values), orient="index").rename_axis("parameter")


def _values(estimate: Estimate) -> dict[str, to.UncertainValue]:
    return {
        name: to.UncertainValue(
            value=estimate.value(name),
            standard_error=estimate.standard_error(name),
            unit=estimate.unit(name),
            interval_95=estimate.interval(name),
        )
        for name in estimate.names
        if name not in estimate.refused
    }


def _label(panel: Axes, across: str, up: str, most: int = 8) -> None:
    """Label ``panel``, with a legend if it has at most ``most`` entries."""
    panel.set_xlabel(across)
    panel.set_ylabel(up)
    handles, labels = panel.get_legend_handles_labels()
    if 0 < len(labels) <= most:
        panel.legend(handles, labels, frameon=False, fontsize=9)
