"""From logs and a parameter file to the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rovid.diagnose.diagnosis import Diagnosis
from rovid.diagnose.parts import parts_of
from rovid.errors import DataError
from rovid.identify.estimate import Estimate
from rovid.output import require_writable
from rovid.parameters import Parameters
from rovid.report.evidence import Evidence
from rovid.report.page import write_report
from rovid.simulation import TrialSimulation, simulate_runs
from rovid.study import Study

_T = TypeVar("_T")
_PATIENCE = "Diagnosing, which takes ten seconds or more (--no-diagnosis leaves it out):"


def build_report(
    stored: Parameters,
    study: Study,
    folder: Path,
    *,
    diagnosed: bool = True,
    report: Callable[[str], None] = lambda _: None,
) -> Path:
    """Work the evidence out anew from the logs and write the page.

    Parameters that the file does not hold yet are fitted and written to it. Those of the diagnosis are not.

    Parameters
    ----------
    diagnosed
        Whether the page says what the simulation misses, which takes longer than all the rest.
    report
        Called with a line of text as the work goes on.

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
    diagnosis, diagnosis_refusal = _diagnosis(study, stored.drag(), folder, report) if diagnosed else (None, "")
    report("Drawing and writing the page …")
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
            diagnosis=diagnosis,
            diagnosis_refusal=diagnosis_refusal,
            compared=None if diagnosis is None else most_improved(study, diagnosis),
        ),
    )


def _or_refusal(fit: Callable[[], _T]) -> tuple[_T | None, str]:
    try:
        return fit(), ""
    except DataError as error:
        return None, str(error)


def _diagnosis(
    study: Study, drag: Estimate | None, folder: Path, report: Callable[[str], None]
) -> tuple[Diagnosis | None, str]:
    if study.runs is not None:
        require_writable(folder / "index.html")
    report(_PATIENCE)
    return _or_refusal(lambda: study.diagnosis(lambda text: report(f"{_PATIENCE} {text}"), drag=drag))


def _simulations(study: Study, stored: Parameters) -> tuple[TrialSimulation, ...]:
    if study.runs is None or not {"inertia", "quadratic_drag"} <= set(stored.entries):
        return ()
    model = stored.model()
    study.require(model.effects)
    return tuple(simulate_runs(study.runs.items, model, study.vehicle))


def most_improved(study: Study, diagnosis: Diagnosis) -> tuple[TrialSimulation, TrialSimulation] | None:
    """The trial whose simulated rate what was found improves most, without and with it; None where it does not."""
    base, extended = diagnosis.base, diagnosis.extended
    if study.runs is None or base is None or extended is None or not extended.model.effects:
        return None
    # Few trials are diagnosed in parts, and a part is simulated from its own start.
    runs = (parts_of(study.runs.items, study.vehicle, study.runs.cutoff) or study.runs).items
    before, after = (simulate_runs(runs, side.model, study.vehicle) for side in (base, extended))
    pairs = [pair for pair in zip(before, after, strict=True) if pair[1].fit.rmse < pair[0].fit.rmse]
    return max(pairs, key=lambda pair: pair[0].fit.rmse - pair[1].fit.rmse, default=None)
