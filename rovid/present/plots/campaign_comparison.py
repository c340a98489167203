"""Two campaigns over each other: their parameters, and their drag."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.compare.difference_tests import DifferenceTest
from rovid.core.array_types import FloatArray
from rovid.present.plots.canvas import BLACK, BLUE, GREY, ORANGE, panel_grid, report_style
from rovid.trial.axis import Axis

_STEPS = 200
_DRAGS = ["quadratic_drag", "linear_drag"]
# Standard errors to either end of a 95 % interval.
_REACH = NormalDist().inv_cdf(0.975)


@report_style
def plot_ratios(changes: DifferenceTest, titles: dict[str, str]) -> Figure | None:
    """B over A of each parameter with its 95 % interval; None where nothing can be divided.

    ``titles`` are what parameters are called.
    """
    divided = {name: changes.ratio(name) for name in changes.pair.names}
    found = {name: ratio for name, ratio in divided.items() if ratio is not None}
    if not found:
        return None
    figure, ((panel,),) = panel_grid([(0.42 * len(found) + 0.3, 1)], left=2.4, top=0.15)
    for at, (name, (ratio, error)) in enumerate(found.items()):
        sure = any(name in change.candidate.parameters for change in changes.established)
        colour = ORANGE if sure else BLACK
        filled = colour if sure else "white"
        panel.errorbar(ratio, at, xerr=_REACH * error, fmt="o", capsize=3, color=colour, markerfacecolor=filled)
    panel.axvline(1.0, color=GREY, linestyle="--")
    panel.set_yticks(range(len(found)), [titles[name] for name in found])
    panel.set_ylim(len(found) - 0.5, -0.5)
    panel.set_xlabel("B over A, share of 1, with 95 % interval")
    return figure


@report_style
def plot_drag(changes: DifferenceTest, fastest: float, axis: Axis) -> Figure | None:
    """Drag of A and of B against the rate up to the ``fastest``, with 95 % bands; None where one is not known."""
    pair = changes.pair
    if not set(_DRAGS) <= set(pair.names):
        return None
    at = [pair.names.index(name) for name in _DRAGS]
    figure, ((top,), (bottom,)) = panel_grid([(3.0, 1), (1.5, 1)], top=0.25, down=0.2, share_x=True)
    rate = np.linspace(0.0, fastest, _STEPS)
    design = np.column_stack((rate**2, rate))
    sides = ((pair.a, pair.covariance_a, BLUE, "-", "A"), (pair.b, pair.covariance_b, ORANGE, "--", "B"))
    for values, covariance, colour, dashes, name in sides:
        _band(top, rate, design, (values[at], covariance[np.ix_(at, at)]), (colour, dashes, f"{name}, 95 % band"))
    both = pair.difference[at], pair.covariance[np.ix_(at, at)]
    _band(bottom, rate, design, both, (BLACK, "-", "B less A"))
    bottom.axhline(0.0, color=GREY, linestyle="--")
    top.set_ylabel(f"drag, {axis.force_unit}")
    bottom.set_ylabel(f"B less A, {axis.force_unit}")
    bottom.set_xlabel(f"{axis.rate_words}, {axis.rate_unit}")
    top.legend(loc="upper left")
    return figure


def _band(
    panel: Axes,
    rate: FloatArray,
    design: FloatArray,
    known: tuple[FloatArray, FloatArray],
    look: tuple[str, str, str],
) -> None:
    values, covariance = known
    colour, dashes, name = look
    line = design @ values
    reach = _REACH * np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", design, covariance, design), 0.0))
    panel.fill_between(rate, line - reach, line + reach, color=colour, alpha=0.2, linewidth=0)
    panel.plot(rate, line, dashes, color=colour, label=name)
