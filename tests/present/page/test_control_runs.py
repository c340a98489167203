"""The courses of the controller's runs."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.control.design import ControllerDesign
from rovid.control.step_metrics import limit_cycle
from rovid.present.page.control_runs import paper_step_runs
from rovid.present.page.report_data import ReportData
from tests.present.conftest import BIAS


def test_the_courses_are_those_of_the_runs(day: ReportData, pushed: ControllerDesign) -> None:
    courses = paper_step_runs(pushed)
    for name, ways in courses.items():
        run = next(run for run in pushed.runs if run.name == name and run.effects_known)
        course = ways["aid of drag and effects"]
        assert limit_cycle(course.time, np.degrees(course.heading)) == run.metrics.limit_cycle
        step = np.degrees(course.setpoint[0] - course.heading[0])
        # Without disturbance it ends where it shall; what the aid does not know of leaves its size over kp.
        ends = {way: np.degrees(each.setpoint[-1] - each.heading[-1]) for way, each in ways.items()}
        assert ends["aid of drag and effects"] == pytest.approx(0.0, abs=1e-3 * step)
        assert ends["aid of drag alone"] == pytest.approx(-np.degrees(BIAS.value / pushed.law.kp), rel=0.02)
