"""What was found beside its rivals."""

from __future__ import annotations

from matplotlib.figure import Figure

from rovid.diagnose.result import Finding
from rovid.present.plots.canvas import BLACK, BLUE, GREY, ORANGE, PALE, sheet, shortened, styled
from rovid.present.tables.diagnosis import RIVALS, name_of, standing

_NAME = 40  # letters beside a bar
_LOOKS = {
    "found": (BLUE, ""),
    "not ruled out": (ORANGE, "///"),
    "ruled out": (GREY, ""),
    "depends on a signal": (PALE, "..."),
}


@styled
def rival_gains(finding: Finding) -> Figure:
    """Gain of what was found and of the best causes in its place; those not ruled out are hatched."""
    axis = finding.estimate.axis
    names, gains, labels = [name_of(finding.effect, axis)], [finding.worth], ["found"]
    for rival in finding.rivals[:RIVALS]:
        names.append(name_of(rival.effect, axis))
        gains.append(rival.worth)
        labels.append(standing(finding, rival))
    figure, ((panel,),) = sheet([(0.3 * len(gains) + 0.15, 1)], left=3.2, right=0.55)
    for label, (colour, hatch) in _LOOKS.items():
        rows = [row for row, each in enumerate(labels) if each == label]
        if not rows:
            continue
        shown = [gains[row] for row in rows]
        bars = panel.barh(rows, shown, height=0.62, color=colour, hatch=hatch, edgecolor="white", label=label)
        panel.bar_label(bars, [f"{gain:.0f}" for gain in shown], padding=3, fontsize=9)
    panel.set_yticks(range(len(names)), [shortened(name, _NAME) for name in names])
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.axvline(0.0, color=BLACK, linewidth=0.8)
    panel.margins(x=0.08)
    panel.set_xlabel("log-likelihood gained, less the price of the parameters")
    panel.grid(visible=False, axis="y")
    panel.set_axisbelow(True)
    figure.legend(*panel.get_legend_handles_labels(), ncols=4, loc="upper right", borderaxespad=0.1)
    return figure
