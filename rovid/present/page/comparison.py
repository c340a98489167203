"""The page of a comparison of two campaigns."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
from markupsafe import Markup

from rovid import __version__
from rovid.compare.comparison import Comparison
from rovid.core.output_files import OutputFile, OutputSet
from rovid.present.number_format import parameter_title
from rovid.present.page.page_files import long_date, template_environment
from rovid.present.plots.canvas import WIDTH, render_inline_svg
from rovid.present.plots.results import plot_drag, plot_ratios
from rovid.present.plots.trials import plot_before_after
from rovid.present.report_data import worst_first
from rovid.present.sentences import cause_title, comparison_headline, comparison_sentences, document_key
from rovid.present.tables.diagnosis import changes_table, cross_prediction_table
from rovid.trial.assumptions import Assumptions

_ROW_HEIGHTS = (1.7, 1.2)  # in


def write_comparison(
    claim: OutputSet, page: OutputFile, comparison: Comparison, guess: Assumptions, notes: Sequence[str]
) -> None:
    """Write the page. Raises OutputError if the page cannot be written; an earlier page stays complete."""
    environment = template_environment()
    environment.globals["guess"] = guess
    context: dict[str, Any] = {
        "comparison": comparison,
        "headline": comparison_headline(comparison),
        "reasons": list(comparison_sentences(comparison)),
        "parameters": changes_table(comparison, guess),
        "predictions": cross_prediction_table(comparison),
        "pictures": list(_pictures(comparison)),
        "causes": [list(map(cause_title, names)) for names in comparison.causes],
        "warnings": [*comparison.warnings, *notes],
        "today": long_date(datetime.now(UTC).date()),
        "version": __version__,
    }
    claim.write({page: environment.get_template("comparison.html.j2").render(context)})


def _pictures(comparison: Comparison) -> Iterator[tuple[Markup, str]]:
    """Each picture with its caption."""
    changes, axis = comparison.changes, comparison.a.axis
    ratios = plot_ratios(changes, {name: parameter_title(document_key(name)) for name in changes.pair.names})
    if ratios is not None:
        yield (
            render_inline_svg(ratios, "ratios"),
            "B over A of each parameter, by itself, with its 95 % interval; filled: the parameter changed.",
        )
    rates = [run.rates.rate for campaign in (comparison.a, comparison.b) for run in campaign.runs]
    fastest = float(np.nanmax(np.abs(np.concatenate(rates)))) if rates else 1.0
    drag = plot_drag(changes, fastest, axis)
    if drag is not None:
        yield render_inline_svg(drag, "drag"), f"Drag against {axis.rate_words}, up to the fastest of both."
    for runs, other in (("a", "b"), ("b", "a")):
        by_other, own = (comparison.predictions.get((model, runs)) for model in (other, runs))
        if by_other is None or own is None:
            continue
        worst, *_ = worst_first(by_other.simulations)
        figure = plot_before_after(
            by_other.simulations[worst],
            own.simulations[worst],
            width=WIDTH,
            rows=_ROW_HEIGHTS,
            names=(f"model of {other.upper()}", f"model of {runs.upper()}"),
        )
        trial = own.simulations[worst].run.trial.name
        caption = f"{trial} of {runs.upper()}, which the other model predicts worst."
        yield render_inline_svg(figure, f"worst-{runs}"), caption
