"""Inertia by every method, side by side."""

from __future__ import annotations

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.core.stats import t_quantile
from rovid.estimate.inertia import METHODS, InertiaFit
from rovid.present.number_text import unit_symbol
from rovid.present.plots.canvas import BLACK, BLUE, GREY, ORANGE, panel_grid, report_style

SHORT = {
    "peak": "peak method",
    "orbit_integral": "orbit integral",
    "harmonic_balance": "harmonic balance",
    "regression": "regression",
}
# Intervals that together take less than this share of the axis from zero are shown once more, enlarged.
_CROWDED = 0.3


@report_style
def plot_inertia_methods(fit: InertiaFit, rigid_body: float | None) -> Figure:
    """Each method's inertia with its 95 % interval and single runs; where they crowd, enlarged too."""
    names = list(fit.methods)
    panels = 2 if _crowded(fit) else 1
    height = 0.5 * len(fit.methods) + 0.3
    figure, ((whole, *more),) = panel_grid([(height, panels)], left=1.75, across=0.4, top=0.4)
    _panel(whole, fit, names)
    whole.set_yticks(range(len(names)), [_label(fit, name) for name in names])
    whole.set_xlim(left=0.0)
    whole.set_title("from zero")
    if rigid_body is not None:
        whole.axvline(rigid_body, color=GREY, linestyle="--", label="rigid body alone")
        whole.legend(loc="lower left", bbox_to_anchor=(0.3, 1.0), borderaxespad=0.1)
    for enlarged in more:
        _panel(enlarged, fit, _unbiased(fit))
        enlarged.set_yticks(range(len(names)), [""] * len(names))
        enlarged.locator_params(axis="x", nbins=6)
        enlarged.set_title("enlarged, without the peak method" if "peak" in fit.methods else "enlarged")
    return figure


def method_title(name: str) -> str:
    """What a method is called where space is short."""
    return SHORT.get(name, METHODS.get(name, name))


def method_interval(fit: InertiaFit, name: str) -> tuple[float, float] | None:
    """95 % interval of the inertia by the method ``name``; None where its error is not known or means nothing.

    The scatter of a biased method over a few runs says nothing of how far off it is.
    """
    reading = fit.methods[name]
    if name == "peak" or not math.isfinite(reading.standard_error):
        return None
    if name == fit.chosen:
        return fit.estimate.interval("inertia")
    if name == "regression" and fit.regression is not None:
        return fit.regression.estimate.interval("inertia")
    periods = sum(trial.cycles for trial in fit.trials)
    degrees_of_freedom = periods - 1.0 if periods > 1 else math.inf
    reach = t_quantile(0.975, degrees_of_freedom) * reading.standard_error
    return reading.value - reach, reading.value + reach


def _unbiased(fit: InertiaFit) -> list[str]:
    """Names of the methods that do not go by peaks."""
    return [name for name in fit.methods if name != "peak"]


def _crowded(fit: InertiaFit) -> bool:
    """Whether all intervals lie so close that an axis from zero would hide them."""
    ends = _interval_ends(fit)
    if len(fit.methods) < 2 or not ends:
        return False
    return max(ends) - min(ends) < _CROWDED * max(ends)


def _interval_ends(fit: InertiaFit) -> list[float]:
    """Both ends of each unbiased method's interval, kg m^2."""
    ends: list[float] = []
    for name in _unbiased(fit):
        ends += method_interval(fit, name) or ()
    return ends


def _label(fit: InertiaFit, name: str) -> str:
    if name == "peak":
        return f"{method_title(name)}\n({_bias(fit)})"
    if name == fit.chosen:
        return f"{method_title(name)}\n(best of these)"
    return method_title(name)


def _bias(fit: InertiaFit) -> str:
    if fit.peak_bias is None:
        return "biased"
    return f"biased: {100.0 * fit.peak_bias:.0f} % of true"


def _panel(panel: Axes, fit: InertiaFit, names: list[str]) -> None:
    for name in names:
        _one_method(panel, list(fit.methods).index(name), name, fit)
    panel.set_ylim(len(fit.methods) - 0.45, -0.55)
    panel.set_xlabel(f"inertia, {unit_symbol(fit.estimate.unit('inertia'))}")
    panel.grid(visible=False, axis="y")


def _one_method(panel: Axes, row: int, name: str, fit: InertiaFit) -> None:
    reading = fit.methods[name]
    colour, marker = _look(fit, name)
    for _, value, _ in reading.runs:
        panel.plot(value, row + 0.26, "|", color=colour, markersize=7)
    interval = method_interval(fit, name)
    if interval is not None:
        low, high = interval
        panel.errorbar(reading.value, row, xerr=0.5 * (high - low), color=colour, capsize=4, elinewidth=1.6)
    panel.plot(reading.value, row, marker, color=colour, markersize=6, markeredgewidth=1.8)


def _look(fit: InertiaFit, name: str) -> tuple[str, str]:
    """Colour and marker of the method ``name``."""
    if name == "peak":
        return ORANGE, "x"
    if name == fit.chosen:
        return BLUE, "o"
    return BLACK, "o"
