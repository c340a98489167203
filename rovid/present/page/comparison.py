"""The page of two campaigns: both over each other."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from rovid import __version__
from rovid.compare.comparison import Comparison
from rovid.core.atomic_write import OutputFile, OutputSet
from rovid.core.formatting import plus_minus
from rovid.core.signatures import COMPARISON
from rovid.model.simulation import TrialSimulation
from rovid.present.number_text import format_number, parameter_title, unit_symbol
from rovid.present.page.templating import template_environment
from rovid.present.plots.before_after import plot_before_after
from rovid.present.plots.campaign_comparison import plot_drag, plot_ratios
from rovid.present.plots.canvas import WIDTH, render_inline_svg
from rovid.present.tables.table import ResultTable, TableBuilder, mixed_number_column, number_column, text_column
from rovid.present.terminal.comparison import (
    comparison_headline,
    comparison_sentences,
    confidence_cell,
    document_key,
    effect_title,
    joint_value,
)
from rovid.trial.assumptions import Assumptions

_ROWS = (1.7, 1.2)  # in
_HORIZONS = (10.0, 60.0)


def comparison_page(path: Path) -> OutputFile:
    """The page at ``path``."""
    return OutputFile(path, COMPARISON)


def write_comparison(
    claim: OutputSet, page: OutputFile, comparison: Comparison, guess: Assumptions, notes: Sequence[str]
) -> None:
    """Write the page.

    Raises
    ------
    OutputError
        It cannot be written; one that was there stays whole.
    """
    environment = template_environment()
    environment.globals["guess"] = guess
    today = datetime.now(UTC).date()
    context: dict[str, Any] = {
        "comparison": comparison,
        "headline": comparison_headline(comparison),
        "reasons": list(comparison_sentences(comparison)),
        "parameters": _parameters(comparison, guess),
        "predictions": _predictions(comparison) if comparison.predictions else None,
        "pictures": list(_pictures(comparison)),
        "causes": [[effect_title(name) for name in names] for names in comparison.causes],
        "warnings": [*comparison.warnings, *notes],
        "today": f"{today:%d %B %Y}".lstrip("0"),
        "version": __version__,
    }
    claim.write({page: environment.get_template("comparison.html.j2").render(context)})


def _parameters(comparison: Comparison, guess: Assumptions) -> ResultTable:
    changes, pair = comparison.changes, comparison.changes.pair
    rows = TableBuilder(
        "Each campaign by itself; together where both share what did not change; ± one standard error",
        text_column("parameter"),
        mixed_number_column("B over A"),
        text_column("changed"),
        mixed_number_column("A"),
        mixed_number_column("B"),
        mixed_number_column("together"),
        text_column("unit"),
    )
    for at, name in enumerate(pair.names):
        ratio, plain = changes.ratio(name), pair.units[at]
        rows.add(
            parameter_title(document_key(name)),
            format_number(None) if ratio is None else plus_minus(*ratio),
            confidence_cell(changes, name),
            guess.mark_number(plus_minus(float(pair.a[at]), math.sqrt(pair.covariance_a[at, at])), plain),
            guess.mark_number(plus_minus(float(pair.b[at]), math.sqrt(pair.covariance_b[at, at])), plain),
            guess.mark_number(joint_value(changes, name), plain),
            unit_symbol(plain),
        )
    return rows.grid()


def _predictions(comparison: Comparison) -> ResultTable:
    axis = comparison.a.axis
    rows = TableBuilder(
        "Runs simulated freely, by the model of the other campaign and by their own",
        text_column("runs of"),
        text_column("model of"),
        number_column(f"{axis.rate_words} R²"),
        *(number_column(f"{axis.position_words} after {horizon:.0f} s", axis.display_unit[0]) for horizon in _HORIZONS),
    )
    for runs in ("a", "b"):
        for model in ("a", "b"):
            made = comparison.predictions.get((model, runs))
            if made is not None:
                errors = [format_number(axis.to_display(made.position_errors[horizon]), ".3g") for horizon in _HORIZONS]
                rows.add(runs.upper(), model.upper(), format_number(made.rate_r2, ".4f"), *errors)
    return rows.grid()


def _pictures(comparison: Comparison) -> Iterator[tuple[Markup, str]]:
    """Each picture with its caption."""
    changes, axis = comparison.changes, comparison.a.axis
    forest = plot_ratios(changes, {name: parameter_title(document_key(name)) for name in changes.pair.names})
    if forest is not None:
        yield (
            render_inline_svg(forest, "ratios"),
            "B over A of each parameter, by itself, with its 95 % interval; filled: it changed.",
        )
    rates = [run.rates.rate for day in (comparison.a, comparison.b) for run in day.runs]
    fastest = float(np.nanmax(np.abs(np.concatenate(rates)))) if rates else 1.0
    drag = plot_drag(changes, fastest, axis)
    if drag is not None:
        yield render_inline_svg(drag, "drag"), f"Drag against {axis.rate_words}, up to the fastest of both."
    for runs, other in (("a", "b"), ("b", "a")):
        by_other, own = (comparison.predictions.get((model, runs)) for model in (other, runs))
        if by_other is not None and own is not None:
            worst = _worst(by_other.simulations)
            names = (f"model of {other.upper()}", f"model of {runs.upper()}")
            figure = plot_before_after(
                by_other.simulations[worst], own.simulations[worst], width=WIDTH, rows=_ROWS, names=names
            )
            name = own.simulations[worst].run.trial.name
            yield (
                render_inline_svg(figure, f"worst-{runs}"),
                f"{name} of {runs.upper()}, which the other model foretells worst.",
            )


def _worst(simulations: Sequence[TrialSimulation]) -> int:
    return int(np.argmax([np.nan_to_num(item.fit.rmse) for item in simulations]))
