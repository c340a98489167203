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
from rovid.core.atomic_write import Claim, Output
from rovid.core.formatting import plus_minus
from rovid.core.signatures import COMPARISON
from rovid.model.simulation import TrialSimulation
from rovid.present.number_text import number, title, unit
from rovid.present.page.templating import environment_of
from rovid.present.plots.before_after import before_after
from rovid.present.plots.campaign_comparison import drags, ratios
from rovid.present.plots.canvas import WIDTH, inline
from rovid.present.tables.table import Grid, Table, of_numbers, of_text, of_unlike
from rovid.present.terminal.comparison import headline, named, reasons, shared_in_words, sure_in_words, title_of_cause
from rovid.trial.assumptions import Guesswork

_ROWS = (1.7, 1.2)  # in
_HORIZONS = (10.0, 60.0)


def comparison_page(path: Path) -> Output:
    """The page at ``path``."""
    return Output(path, COMPARISON)


def write_comparison(
    claim: Claim, page: Output, comparison: Comparison, guess: Guesswork, notes: Sequence[str]
) -> None:
    """Write the page.

    Raises
    ------
    OutputError
        It cannot be written; one that was there stays whole.
    """
    environment = environment_of()
    environment.globals["guess"] = guess
    today = datetime.now(UTC).date()
    context: dict[str, Any] = {
        "comparison": comparison,
        "headline": headline(comparison),
        "reasons": list(reasons(comparison)),
        "parameters": _parameters(comparison, guess),
        "predictions": _predictions(comparison) if comparison.predictions else None,
        "pictures": list(_pictures(comparison)),
        "causes": [[title_of_cause(name) for name in names] for names in comparison.causes],
        "warnings": [*comparison.warnings, *notes],
        "today": f"{today:%d %B %Y}".lstrip("0"),
        "version": __version__,
    }
    claim.write({page: environment.get_template("comparison.html.j2").render(context)})


def _parameters(comparison: Comparison, guess: Guesswork) -> Grid:
    changes, pair = comparison.changes, comparison.changes.pair
    rows = Table(
        "Each campaign by itself; together where both share what did not change; ± one standard error",
        of_text("parameter"),
        of_unlike("B over A"),
        of_text("changed"),
        of_unlike("A"),
        of_unlike("B"),
        of_unlike("together"),
        of_text("unit"),
    )
    for at, name in enumerate(pair.names):
        ratio, plain = changes.ratio(name), pair.units[at]
        rows.add(
            title(named(name)),
            number(None) if ratio is None else plus_minus(*ratio),
            sure_in_words(changes, name),
            guess.marked(plus_minus(float(pair.a[at]), math.sqrt(pair.covariance_a[at, at])), plain),
            guess.marked(plus_minus(float(pair.b[at]), math.sqrt(pair.covariance_b[at, at])), plain),
            guess.marked(shared_in_words(changes, name), plain),
            unit(plain),
        )
    return rows.grid()


def _predictions(comparison: Comparison) -> Grid:
    axis = comparison.a.axis
    rows = Table(
        "Runs simulated freely, by the model of the other campaign and by their own",
        of_text("runs of"),
        of_text("model of"),
        of_numbers(f"{axis.rate_words} R²"),
        *(of_numbers(f"{axis.position_words} after {horizon:.0f} s", axis.shown[0]) for horizon in _HORIZONS),
    )
    for runs in ("a", "b"):
        for model in ("a", "b"):
            made = comparison.predictions.get((model, runs))
            if made is not None:
                errors = [number(axis.in_shown(made.position_errors[horizon]), ".3g") for horizon in _HORIZONS]
                rows.add(runs.upper(), model.upper(), number(made.rate_r2, ".4f"), *errors)
    return rows.grid()


def _pictures(comparison: Comparison) -> Iterator[tuple[Markup, str]]:
    """Each picture with its caption."""
    changes, axis = comparison.changes, comparison.a.axis
    forest = ratios(changes, {name: title(named(name)) for name in changes.pair.names})
    if forest is not None:
        yield (
            inline(forest, "ratios"),
            "B over A of each parameter, by itself, with its 95 % interval; filled: it changed.",
        )
    rates = [run.rates.rate for day in (comparison.a, comparison.b) for run in day.runs]
    fastest = float(np.nanmax(np.abs(np.concatenate(rates)))) if rates else 1.0
    drag = drags(changes, fastest, axis)
    if drag is not None:
        yield inline(drag, "drag"), f"Drag against {axis.rate_words}, up to the fastest of both."
    for runs, other in (("a", "b"), ("b", "a")):
        by_other, own = (comparison.predictions.get((model, runs)) for model in (other, runs))
        if by_other is not None and own is not None:
            worst = _worst(by_other.simulations)
            names = (f"model of {other.upper()}", f"model of {runs.upper()}")
            figure = before_after(
                by_other.simulations[worst], own.simulations[worst], width=WIDTH, rows=_ROWS, names=names
            )
            name = own.simulations[worst].run.trial.name
            yield inline(figure, f"worst-{runs}"), f"{name} of {runs.upper()}, which the other model foretells worst."


def _worst(simulations: Sequence[TrialSimulation]) -> int:
    return int(np.argmax([np.nan_to_num(item.fit.rmse) for item in simulations]))
