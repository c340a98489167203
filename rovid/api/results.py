"""Results as typed records. Each is made from the record that its command prints, and has the same numbers."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import pandas as pd
from rich.console import Console

from rovid.compare.comparison import Comparison
from rovid.core.errors import DataError
from rovid.core.formatting import SafeConsole, plus_minus, to_json
from rovid.core.output_files import OutputSet
from rovid.diagnose.result import Diagnosis, Finding
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import ExperimentPlan, command_csv
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.export.run_export import VerifiedExport, select_exporter
from rovid.model.simulation import simulate_runs
from rovid.preflight.check import LogCheck
from rovid.present.console import show_caution
from rovid.present.documents.diagnosis import all_faults, comparison_document, diagnosis_document, finding_document
from rovid.present.documents.fits import likelihood_document
from rovid.present.documents.results import check_document, export_document, plan_document
from rovid.present.number_format import unit_symbol
from rovid.present.terminal.check import show_check
from rovid.present.terminal.diagnosis import show_comparison, show_study_diagnosis
from rovid.present.terminal.results import show_export, show_fit, show_likelihood, show_plan
from rovid.store.study import Study
from rovid.trial.fault import Fault
from rovid.trial.vehicle import Vehicle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Columns of text in a notebook, and its look there.
_WIDTH = 110
_HTML = '<pre style="white-space:pre;overflow-x:auto;line-height:1.3;font-family:monospace">{code}</pre>'


@dataclass(frozen=True, kw_only=True)
class UncertainValue:
    """A parameter with its uncertainty; printed, it is rounded to its standard error."""

    value: float
    standard_error: float
    unit: str
    interval_95: tuple[float, float]

    def __str__(self) -> str:
        return f"{plus_minus(self.value, self.standard_error)} {unit_symbol(self.unit)}".rstrip()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Record:
    """What all results share. Printed, a record shows what its command prints."""

    document: dict[str, Any]  #: What the command prints with --json.
    show: Callable[[Console], None]
    draw: Callable[[Axes], None]
    table: pd.DataFrame

    def to_json(self) -> str:
        """The document as JSON text; numbers that are not finite are null."""
        return to_json(self.document)

    def to_pandas(self) -> pd.DataFrame:
        """The main table: a row for each log, parameter, cause, candidate run, or part that a format does not hold."""
        return self.table.copy()

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the main result into ``axes``, by default those of a new figure, and return them.

        A check draws the position in each log, a fit the measured and simulated rate of the longest log, a diagnosis
        the position error after a restart on runs that were not fitted, a cause its gain and that of its alternatives,
        a plan the commands, a comparison the ratios of all parameters, and an export the error of the yaw rate.

        Raises
        ------
        DataError
            There is nothing to draw.
        """
        if axes is None:
            from matplotlib import pyplot as plt

            _, axes = plt.subplots(figsize=(9.0, 3.6), layout="constrained")
        self.draw(axes)
        return axes

    def __repr__(self) -> str:
        return self._printed().export_text().rstrip()

    def _repr_html_(self) -> str:
        """The printed result with its colours, for notebooks."""
        return self._printed().export_html(inline_styles=True, code_format=_HTML)

    def _printed(self) -> SafeConsole:
        console = SafeConsole(record=True, width=_WIDTH, file=io.StringIO(), force_terminal=True, legacy_windows=False)
        self.show(console)
        return console


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CheckRecord(Record):
    """Result of `rovid check`."""

    verdict: Literal["go", "care", "no_go"]  #: Whether the logs are ready for a fit.
    faults: tuple[Fault, ...]  #: Faults of the logs, with their remedies.


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ModelRecord(Record):
    """Result of `rovid fit`; a diagnosis has the same fields, and more."""

    #: Parameter -> value, as ``inertia`` or ``thruster_lag.time_constant``; empty where there is no model.
    parameters: dict[str, UncertainValue]
    effects: tuple[str, ...]  #: Ids of the effects in the model.
    faults: tuple[Fault, ...]  #: Faults of the logs, with their remedies.
    warnings: tuple[str, ...]  #: Sentences on what limits the result.
    estimate: Estimate | None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CauseRecord(Record):
    """An established or suspected cause of what the simulation gets wrong."""

    effect: str  #: Id of the effect, as ``thruster_lag``.
    parameters: dict[str, UncertainValue]  #: Parameter, without the effect's name -> value.
    confidence: float  #: Probability that this cause, or one that it cannot be told from, acts.
    evidence: str  #: confirmed, likely or possible.
    cannot_be_told_from: tuple[str, ...]  #: Ids of the causes that these data do not rule out.

    def __repr__(self) -> str:
        sizes = ", ".join(f"{name} {value}" for name, value in self.parameters.items())
        return f"{self.effect} ({self.evidence}, {self.confidence:.2f}): {sizes}"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DiagnosisRecord(ModelRecord):
    """Result of `rovid diagnose`; ``parameters`` and ``effects`` are those of the extended model."""

    verdict: str  #: found, suspected, nothing_found, unexplained, too_little_data or bad_logs.
    findings: tuple[CauseRecord, ...]  #: Established causes, the largest gain first.
    suspects: tuple[CauseRecord, ...]  #: Likely or possible causes, the most probable first.


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlanRecord(Record):
    """Result of `rovid plan`."""

    decides: bool  #: Whether the best run is expected to distinguish the causes.
    #: The best run: time in s, and a command for each thruster; each row holds until the next.
    commands: pd.DataFrame


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ComparisonRecord(Record):
    """Result of `rovid compare`."""

    verdict: str  #: same, changed or cannot_tell.
    changed: tuple[str, ...]  #: Parameters that changed.


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ExportRecord(Record):
    """Result of `rovid export`: the content of a simulator's file, verified by re-simulation."""

    format: str
    content: str | bytes
    not_held: tuple[str, ...]  #: Parts of the model that the format cannot hold.

    def save(self, path: str | Path | None = None) -> Path:
        """Write the file, by default under the name of the format, and return its path.

        Raises
        ------
        RovidError
            There is a file of this name that rovid did not write, or the file cannot be written.
        """
        _, target = select_exporter(self.format, None if path is None else Path(path))
        OutputSet([target]).write({target: self.content})
        return target.path


# --- records from the results of the commands ---------------------------------------------------------------------


def check_record(check: LogCheck, vehicle: Vehicle) -> CheckRecord:
    """The record of a check."""

    def show(console: Console) -> None:
        show_caution(console, vehicle.assumptions)
        show_check(console, check)

    def draw(panel: Axes) -> None:
        name, unit = vehicle.axis.position_words, vehicle.axis.display_unit
        for trial, _ in check.rows:
            panel.plot(trial.time, trial.position * unit[1], label=trial.name)
        _label(panel, "time, s", f"{name}, {unit[0]}")

    document = check_document(check, vehicle)
    table = pd.DataFrame(document["logs"]).drop(columns="remarks", errors="ignore")
    return CheckRecord(document=document, show=show, draw=draw, table=table, verdict=check.verdict, faults=check.faults)


def fit_record(fit: LikelihoodFit, logs: Study) -> ModelRecord:
    """The record of a fit."""

    def draw(panel: Axes) -> None:
        from rovid.present.plots.canvas import plot_overlay

        longest = max(logs.runs.items if logs.runs else (), key=lambda run: run.trial.duration)
        (item,) = simulate_runs([longest], fit.model, logs.vehicle)
        plot_overlay(panel, longest.rates.time, item.measured, item.simulated)
        panel.set_title(f"{longest.trial.name}   R² {item.fit.r2:.4f}")
        _label(panel, "time, s", f"{logs.vehicle.axis.rate_words}, {logs.vehicle.axis.rate_unit}")

    document, parameters = likelihood_document(fit, logs), _values(fit.estimate)
    return ModelRecord(
        document=document,
        show=lambda console: show_fit(console, fit, show_likelihood, logs),
        draw=draw,
        table=pd.DataFrame.from_dict(document["parameters"], orient="index").rename_axis("parameter"),
        parameters=parameters,
        effects=tuple(effect.id for effect in fit.model.effects),
        faults=logs.faults,
        warnings=tuple(document["warnings"]),
        estimate=fit.estimate,
    )


def diagnosis_record(diagnosis: Diagnosis, logs: Study) -> DiagnosisRecord:
    """The record of a diagnosis."""

    def draw(panel: Axes) -> None:
        if not diagnosis.horizons:
            text = f"the diagnosis has no prediction errors to plot: its verdict is {diagnosis.verdict}."
            raise DataError(text, mend="Print the diagnosis: it names what is missing.")
        axis = logs.vehicle.axis
        for name, dashes in (("base", "--"), ("extended", "-")):
            errors = [getattr(one, name) * axis.display_unit[1] for one in diagnosis.horizons]
            panel.plot([one.seconds for one in diagnosis.horizons], errors, dashes, marker="o", label=f"{name} model")
        _label(panel, "time after a restart, s", f"{axis.position_words} error (RMS), {axis.display_unit[0]}")

    document, model = diagnosis_document(diagnosis, logs), diagnosis.extended or diagnosis.base
    kinds = ("findings", "suspects")
    keys = ["effect", "evidence", "confidence", "log_likelihood_gain", "held_out_log_likelihood_gain"]
    rows = [{"kind": kind} | {key: one[key] for key in keys} for kind in kinds for one in document[kind]]
    return DiagnosisRecord(
        document=document,
        show=lambda console: show_study_diagnosis(console, diagnosis, logs),
        draw=draw,
        table=pd.DataFrame(rows, columns=["kind", *keys]),
        parameters={} if model is None else _values(model.estimate),
        effects=() if model is None else tuple(effect.id for effect in model.model.effects),
        faults=tuple(all_faults(diagnosis, logs)),
        warnings=tuple(document["warnings"]),
        estimate=None if model is None else model.estimate,
        verdict=diagnosis.verdict,
        findings=tuple(map(_cause_record, diagnosis.findings)),
        suspects=tuple(map(_cause_record, diagnosis.suspects)),
    )


def _cause_record(finding: Finding) -> CauseRecord:
    from rovid.present.plots.results import draw_alternatives
    from rovid.present.terminal.diagnosis import show_finding

    document = finding_document(finding)
    return CauseRecord(
        document=document,
        show=lambda console: show_finding(console, finding),
        draw=lambda panel: draw_alternatives(panel, finding),
        table=pd.DataFrame.from_dict(document["parameters"], orient="index").rename_axis("parameter"),
        effect=finding.effect.id,
        parameters={name.rpartition(".")[2]: value for name, value in _values(finding.estimate).items()},
        confidence=finding.probability,
        evidence=str(finding.evidence),
        cannot_be_told_from=tuple(document["cannot_be_told_from"]),
    )


def plan_record(plan: ExperimentPlan, vehicle: Vehicle) -> PlanRecord:
    """The record of a plan."""

    def draw(panel: Axes) -> None:
        from rovid.present.plots.results import draw_commands

        draw_commands(panel, plan)
        panel.set_title(plan.best.run.name)
        _label(panel, "time, s", "command")

    document = plan_document(plan, vehicle, "", "", ()) | {"command_file": None, "picture": None}
    return PlanRecord(
        document=document,
        show=lambda console: show_plan(console, plan, ()),
        draw=draw,
        table=pd.DataFrame(document["runs"]),
        decides=plan.is_decisive,
        commands=pd.read_csv(io.StringIO(command_csv(plan)), comment="#"),
    )


def comparison_record(comparison: Comparison) -> ComparisonRecord:
    """The record of a comparison."""

    def draw(panel: Axes) -> None:
        from rovid.present.plots.results import draw_ratios

        changes = comparison.changes
        draw_ratios(panel, changes, {name: name.replace("_", " ") for name in changes.pair.names})

    guess = comparison.a.assumptions | comparison.b.assumptions
    document = comparison_document(comparison, guess, ())
    keys = ("ratio", "standard_error", "confidence")
    rows = {
        name: {side: both[side]["value"] for side in "ab"} | {key: both[key] for key in keys}
        for name, both in document["parameters"].items()
    }
    return ComparisonRecord(
        document=document,
        show=lambda console: show_comparison(console, comparison, guess, ()),
        draw=draw,
        table=pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter"),
        verdict=comparison.verdict,
        changed=tuple(document["changed"]),
    )


def export_record(name: str, made: VerifiedExport, vehicle: Vehicle) -> ExportRecord:
    """The record of an export in the format ``name``."""

    def draw(panel: Axes) -> None:
        sizes = {loss.what: loss.percent_of_range for loss in made.losses}
        sizes["the file as a whole"] = made.mismatch.percent_of_range
        panel.barh(list(sizes), list(sizes.values()))
        _label(panel, "error of the yaw rate, % of its range", "")

    document = export_document(name, "", made, vehicle.assumptions) | {"file": None}
    return ExportRecord(
        document=document,
        show=lambda console: show_export(console, Path(name), made),
        draw=draw,
        table=pd.DataFrame(document["not_held"], columns=["what", "why", "yaw_rate_percent_of_range"]),
        format=name,
        content=made.content,
        not_held=tuple(loss.what for loss in made.losses),
    )


def _values(estimate: Estimate) -> dict[str, UncertainValue]:
    return {
        name: UncertainValue(
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
