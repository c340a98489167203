"""Results of the coupled model of surge, sway and yaw on a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from rovid.core.formatting import plus_minus
from rovid.planar.experiment import PlanarPlan
from rovid.planar.fit import PlanarFit
from rovid.planar.trial_simulation import SENSOR_UNITS, PlanarTrialSimulation, pooled_measures
from rovid.present.console import print_labelled, print_text, show_caution, show_faults, show_warnings
from rovid.present.number_format import format_number, unit_symbol
from rovid.present.sentences import effect_title, join_words
from rovid.present.tables.planar import planar_estimate_table, planar_simulation_table, sensor_words
from rovid.present.tables.table import ResultTable, mixed_number_column, text_column
from rovid.present.terminal.results import show_plan
from rovid.store.parameter_file import Parameters
from rovid.store.planar_study import PlanarStudy
from rovid.trial.assumptions import Assumptions

# Sensors that are shown in degrees.
_ANGLES = ("heading",)


def show_planar_fit(console: Console, fit: PlanarFit, study: PlanarStudy, stored: Parameters) -> None:
    """Print the answer, the parameters, and what the logs do not determine."""
    show_caution(console, study.vehicle.assumptions)
    show_faults(console, study.logs.faults)
    print_labelled(console, fit_sentence(fit), _agreement_words(fit))
    console.print()
    console.print(planar_estimate_table(fit.estimate))
    for text in undetermined_sentences(fit):
        print_labelled(console, "Not determined:", text, "bold yellow")
    print_text(console, criterion_sentence(fit))
    print_text(console, f"disturbance: {'; '.join(_disturbance_words(fit, axis) for axis in fit.disturbance)}")
    print_text(console, f"noise: {', '.join(_noise_words(sensor, size) for sensor, size in fit.noise.items())}")
    if fit.latency:
        late = [f"{sensor_words(sensor)} {plus_minus(*pair)} s" for sensor, pair in fit.latency.items()]
        print_text(console, f"latency: {', '.join(late)}")
    show_warnings(console, [*study.remarks(), *fit.warnings])
    print_text(console, f"written to {stored.path}")


def fit_sentence(fit: PlanarFit) -> str:
    """The result of a fit in one sentence."""
    estimate, effects = fit.estimate, [effect_title(one.effect) for one in fit.model.effects]
    determined = len(estimate.names) - len(set(estimate.refused) & set(estimate.names))
    model = "Surge, sway and yaw in one model"
    if effects:
        model += f", with {join_words(effects)}"
    return f"{model}: the logs determine {determined} of {len(estimate.names)} parameters."


def _agreement_words(fit: PlanarFit) -> str:
    r2 = [f"{sensor_words(sensor)} {value:.3f}" for sensor, value in fit.free_run_r2.items() if math.isfinite(value)]
    return f"R² of the free-running simulation: {join_words(r2)}." if r2 else ""


def undetermined_sentences(fit: PlanarFit) -> list[str]:
    """What the logs do not determine, with the reason; parameters with one reason in one sentence."""
    estimate, sentences = fit.estimate, [one.text for one in fit.undetermined]
    listed = {name for one in fit.undetermined for name in one.combination}
    reasons: dict[str, list[str]] = {}
    for name, reason in estimate.refused.items():
        if name not in listed and name in estimate.names:
            reasons.setdefault(reason, []).append(name)
    return [*sentences, *(f"{join_words(names)}: {reason}." for reason, names in reasons.items())]


def criterion_sentence(fit: PlanarFit) -> str:
    """Criterion of the fit, its value, and whether the innovations are white."""
    white = "white" if fit.white else "not white"
    return (
        f"{fit.estimate.method}: log-likelihood {fit.log_likelihood:.1f} over {fit.estimate.samples} readings; "
        f"innovations {white}"
    )


def _disturbance_words(fit: PlanarFit, axis: str) -> str:
    size, time = fit.disturbance[axis]
    unit = "N m" if axis == "yaw" else "N"
    number = fit.estimate.assumptions.mark_number(format_number(size), unit)
    limit = ", at its limit" if axis in fit.at_limit else ""
    return f"{axis} {number} {unit} with a correlation time of {format_number(time, 2)} s{limit}"


def _noise_words(sensor: str, size: float) -> str:
    if sensor in _ANGLES:
        return f"{sensor_words(sensor)} {format_number(math.degrees(size), 2)} deg"
    return f"{sensor_words(sensor)} {format_number(size, 2)} {SENSOR_UNITS[sensor]}"


def show_planar_simulation(
    console: Console, simulations: Sequence[PlanarTrialSimulation], guess: Assumptions, warnings: Sequence[str]
) -> None:
    """Print how well the free-running simulation follows each run."""
    show_caution(console, guess)
    print_labelled(console, simulation_sentence(simulations))
    console.print()
    planar_simulation_table(simulations).print(console, guess)
    show_warnings(console, warnings)


def simulation_sentence(simulations: Sequence[PlanarTrialSimulation]) -> str:
    """Agreement of the free-running simulation with all runs, in one sentence."""
    fits = pooled_measures(simulations)
    words = [f"{sensor_words(sensor)} {format_number(fit.r2, '.3f')}" for sensor, fit in fits.items()]
    return f"R² of the free-running simulation over all runs: {join_words(words)}."


def show_planar_plan(
    console: Console, plan: PlanarPlan, study: PlanarStudy, command_file: Path, warnings: Sequence[str]
) -> None:
    """Print the best run, the candidates, the standard errors before and after, and the runs that were left out."""
    show_caution(console, study.vehicle.assumptions)
    run, estimate = plan.ranked.best.run, plan.fit.estimate
    print_labelled(console, "Next:", f"{run.name}, {run.seconds:.0f} s, because {plan.reason}.")
    show_plan(console, plan.ranked, [command_file])
    columns = map(mixed_number_column, ("by the logs", "with the best run"))
    table = ResultTable("Standard errors, as predicted", text_column("parameter"), *columns, text_column("unit"))
    for name, pair in plan.errors.items():
        cells = [format_number(one, 2) if math.isfinite(one) else "not determined" for one in pair]
        table.add_row(name, *cells, unit_symbol(estimate.unit(name)))
    console.print(table)
    for reason in dict.fromkeys(plan.left_out.values()):
        names = [name for name, why in plan.left_out.items() if why == reason]
        print_text(console, f"left out, {reason}: {'; '.join(names)}")
    show_warnings(console, warnings)
