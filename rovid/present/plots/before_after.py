"""The worst trial before and after: what was measured, both simulations, and how far each is off."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.model.simulation import TrialSimulation
from rovid.present.plots.canvas import BLACK, ORANGE, PALE, decimate_min_max, panel_grid, report_style

_POINTS = 100  # for each inch
NAMES = ("without", "with")


@report_style
def plot_before_after(
    before: TrialSimulation,
    after: TrialSimulation,
    *,
    width: float,
    rows: tuple[float, float],
    names: tuple[str, str] = NAMES,
) -> Figure:
    """Rate above, error of the position below; one simulation alone where nothing was found.

    ``width`` is the figure's and ``rows`` the two panels' height, in inches: a telephone's picture is not a page's.
    ``names`` are those of the two models.
    """
    figure, ((rate,), (position,)) = panel_grid(
        [(height, 1) for height in rows],
        left=0.55,
        right=0.18,
        top=0.5,
        bottom=0.42,
        down=0.34,
        share_x=True,
        width=width,
    )
    axis, trial = before.run.trial.axis, before.run.trial
    time, count = before.run.rates.time, round(_POINTS * width)
    rate.plot(*decimate_min_max(time, before.measured, count), color=PALE, linewidth=4.0, label="measured")
    if after is not before:
        _simulation((rate, position), before, count, (ORANGE, "--", names[0]))
        _simulation((rate, position), after, count, (BLACK, "-", names[1]))
    else:
        _simulation((rate, position), before, count, (BLACK, "-", "simulated"))
    rate.set_title(f"{axis.rate_words}, {axis.rate_unit}", fontsize=9, pad=4)
    position.set_title(f"{axis.position_words} error, {axis.display_unit[0]}", fontsize=9, pad=4)
    for panel, height in zip((rate, position), rows, strict=True):
        panel.locator_params(axis="y", nbins=max(round(3.0 * height), 3))
    position.set_xlabel("time, s")
    position.set_xlim(trial.time[0], trial.time[-1])
    figure.legend(
        *rate.get_legend_handles_labels(), ncols=3, loc="upper left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1
    )
    return figure


def _simulation(panels: tuple[Axes, Axes], item: TrialSimulation, count: int, look: tuple[str, str, str]) -> None:
    (rate, position), (colour, dashes, label) = panels, look
    trial = item.run.trial
    _, factor = trial.axis.display_unit
    known = trial.measured
    off = factor * (item.position - trial.position)[known]
    rate.plot(
        *decimate_min_max(item.run.rates.time, item.simulated, count), dashes, color=colour, linewidth=1.3, label=label
    )
    position.plot(*decimate_min_max(trial.time[known], off, count), dashes, color=colour, linewidth=1.3)
