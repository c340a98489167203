"""The spot of a fault in a log."""

from __future__ import annotations

from matplotlib.figure import Figure

from rovid.present.plots.canvas import BLACK, ORANGE, panel_grid, report_style
from rovid.trial.fault import Fault


@report_style
def plot_fault(fault: Fault) -> Figure:
    """The signal around a ``fault`` with an excerpt, sample by sample, and the instants of the fault."""
    excerpt = fault.excerpt
    if excerpt is None:
        msg = f"{fault.fault} has no excerpt"
        raise ValueError(msg)
    figure, ((axes,),) = panel_grid([(1.4, 1)], left=0.7, right=0.18, top=0.3, bottom=0.45, width=7.2)
    axes.plot(excerpt.time, excerpt.displayed, ".-", color=BLACK, markersize=3.0, linewidth=0.7)
    for instant in fault.at:
        if excerpt.time.min() <= instant <= excerpt.time.max():
            axes.axvline(instant, color=ORANGE, linewidth=1.0)
    axes.set_title(fault.title, loc="left")
    axes.set_xlabel("time, s")
    axes.set_ylabel(excerpt.label)
    return figure
