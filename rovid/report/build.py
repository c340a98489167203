"""From logs and a parameter file to the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rovid.errors import DataError
from rovid.parameters import Parameters
from rovid.report.evidence import Evidence
from rovid.report.page import write_report
from rovid.simulation import TrialSimulation, simulate_runs
from rovid.study import Study

_T = TypeVar("_T")


def build_report(stored: Parameters, study: Study, folder: Path) -> Path:
    """Work the evidence out anew from the logs and write the page.

    Parameters that the file does not hold yet are fitted and written to it.

    Raises
    ------
    OutputError
        The folder or the parameter file cannot be written.
    """
    known = stored
    if not stored.logs:
        stored = stored.with_logs(study.paths, study.vehicle.name, study.campaign)
    drag, drag_refusal = _or_refusal(study.drag)
    if drag is not None and "quadratic_drag" not in stored.entries:
        stored = stored.with_estimate(drag.estimate)
    # A drag that was found together with the inertia cannot judge it; the steady turns of these logs can.
    judge = stored.drag() or (None if drag is None else drag.estimate)
    inertia, inertia_refusal = _or_refusal(lambda: study.inertia(judge))
    if inertia is not None and "inertia" not in stored.entries:
        stored = stored.with_estimate(inertia.estimate)
    if stored is not known or not stored.path.exists():
        stored.write()
    return write_report(
        folder,
        Evidence(
            vehicle=study.vehicle,
            parameters=stored,
            campaign=study.campaign,
            runs=study.runs,
            drag=drag,
            drag_refusal=drag_refusal,
            inertia=inertia,
            inertia_refusal=inertia_refusal,
            simulations=_simulations(study, stored),
        ),
    )


def _or_refusal(fit: Callable[[], _T]) -> tuple[_T | None, str]:
    try:
        return fit(), ""
    except DataError as error:
        return None, str(error)


def _simulations(study: Study, stored: Parameters) -> tuple[TrialSimulation, ...]:
    if study.runs is None or not {"inertia", "quadratic_drag"} <= set(stored.entries):
        return ()
    return tuple(simulate_runs(study.runs.items, stored.model(), study.vehicle))
