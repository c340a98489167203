"""Closed-loop runs: heading against set point, and the torque that the controller asks for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from rovid.control.closed_loop import ClosedLoopRun
from rovid.present.plots.canvas import BLACK, BLUE, GREY, ORANGE, decimate_min_max, panel_grid, report_style

# In units of one over the bandwidth; after that nothing new happens in a step.
_SHOWN = 15.0
_LOOKS = ((BLACK, "-"), (ORANGE, "--"), (BLUE, "-."))


@report_style
def plot_closed_loop(courses: Mapping[str, Mapping[str, ClosedLoopRun]], bandwidth: float) -> Figure:
    """Each step in every way; ``bandwidth`` in rad/s says how much of it is shown."""
    figure, panels = panel_grid([(1.5, 2)] * len(courses), top=0.55, across=0.95, down=0.55)
    for (heading, torque), (name, ways) in zip(panels, courses.items(), strict=True):
        for (way, course), (colour, dashes) in zip(ways.items(), _LOOKS, strict=False):
            early = course.time <= _SHOWN / bandwidth
            time = course.time[early]
            heading.plot(*decimate_min_max(time, np.degrees(course.heading[early])), dashes, color=colour, label=way)
            torque.step(*decimate_min_max(time, course.torque[early]), dashes, where="post", color=colour)
        heading.plot(time, np.degrees(course.setpoint[early]), ":", color=GREY, linewidth=1.8, label="set point")
        heading.set_title(name)
        heading.set_ylabel("heading, deg")
        torque.set_ylabel("torque, N m")
        torque.axhline(0.0, color=BLACK, linewidth=0.8)
    for panel in panels[-1]:
        panel.set_xlabel("time, s")
    figure.legend(*panels[0][0].get_legend_handles_labels(), ncols=4, loc="upper right", borderaxespad=0.1)
    return figure
