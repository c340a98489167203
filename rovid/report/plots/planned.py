"""A run to come: its commands, and what each model predicts."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from rovid.campaign.axis import Axis
from rovid.plan.design import Plan
from rovid.report.plots.canvas import BLACK, BLUE, GREY, ORANGE, PALE, png, sheet, shortened, styled

_LOOKS = ((BLUE, "-"), (ORANGE, "--"))
_ABOVE: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.97), "borderaxespad": 0.0}


@styled
def planned(found: Plan, axis: Axis) -> Figure:
    """Commands, predicted rates, and by how much these differ beside what the disturbance drives."""
    rivals = len(found.beliefs) > 1
    rows = [(1.4, 1), (2.0, 1)]
    if rivals:
        rows.append((1.4, 1))
    figure, panels = sheet(rows, left=1.05, down=0.42, top=0.75, share_x=True)
    run, rates = found.best.run, found.best.rates
    command, rate = panels[0][0], panels[1][0]
    for at, name in enumerate(found.thrusters):
        dashes = ("-", "--", ":", "-.")[at % 4]
        colour = (BLACK, GREY)[at // 4 % 2]
        command.step(run.time, run.commands[:, at], dashes, where="post", color=colour, linewidth=1.0, label=name)
    command.set_ylabel("command")
    if len(found.thrusters) <= 8:
        command.legend(**_ABOVE, ncols=4)
    figure.suptitle(shortened(run.name, 90), x=0.115, ha="left", fontsize=11)
    for belief, values, (colour, dashes) in zip(found.beliefs, rates, _LOOKS, strict=False):
        rate.plot(run.time, values, dashes, color=colour, label=belief.name.replace("_", " "))
    rate.set_ylabel(f"{axis.rate_words},\n{axis.rate_unit}")
    if rivals:
        rate.legend(**_ABOVE, ncols=2)
        apart = panels[2][0]
        band = found.noise_rate
        apart.axhspan(-band, band, color=PALE, alpha=0.5, label="what the disturbance drives, ± one sd")
        apart.plot(run.time, rates[0] - rates[1], color=BLACK, linewidth=1.0, label="difference")
        apart.set_ylabel(f"difference,\n{axis.rate_unit}")
        apart.legend(**_ABOVE, ncols=2)
    panels[-1][0].set_xlabel("time, s")
    return figure


def picture(found: Plan, axis: Axis) -> bytes:
    """The same as PNG."""
    return png(planned(found, axis), "plan")
