"""What was found beside its rivals."""

from __future__ import annotations

from matplotlib.figure import Figure

from rovid.diagnose.result import Finding
from rovid.present.plots.canvas import BLACK, BLUE, GREY, ORANGE, PALE, panel_grid, report_style, shorten_name
from rovid.present.tables.diagnosis import RIVALS, effect_name, rival_status

_NAME = 40  # letters beside a bar
_LOOKS = {
    "found": (BLUE, ""),
    "not ruled out": (ORANGE, "///"),
    "ruled out": (GREY, ""),
    "depends on a signal": (PALE, "..."),
}


@report_style
def plot_alternatives(finding: Finding) -> Figure:
    """Gain of what was found and of the best causes in its place; those not ruled out are hatched."""
    axis = finding.estimate.axis
    names, gains, labels = [effect_name(finding.effect, axis)], [finding.bic_gain], ["found"]
    for rival in finding.alternatives[:RIVALS]:
        names.append(effect_name(rival.effect, axis))
        gains.append(rival.bic_gain)
        labels.append(rival_status(finding, rival))
    figure, ((panel,),) = panel_grid([(0.3 * len(gains) + 0.15, 1)], left=3.2, right=0.55)
    for label, (colour, hatch) in _LOOKS.items():
        rows = [row for row, each in enumerate(labels) if each == label]
        if not rows:
            continue
        shown = [gains[row] for row in rows]
        bars = panel.barh(rows, shown, height=0.62, color=colour, hatch=hatch, edgecolor="white", label=label)
        panel.bar_label(bars, [f"{gain:.0f}" for gain in shown], padding=3, fontsize=9)
    panel.set_yticks(range(len(names)), [shorten_name(name, _NAME) for name in names])
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.axvline(0.0, color=BLACK, linewidth=0.8)
    panel.margins(x=0.08)
    panel.set_xlabel("log-likelihood gained, less the price of the parameters")
    panel.grid(visible=False, axis="y")
    panel.set_axisbelow(True)
    figure.legend(*panel.get_legend_handles_labels(), ncols=4, loc="upper right", borderaxespad=0.1)
    return figure
