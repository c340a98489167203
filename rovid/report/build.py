"""From logs and a parameter file to the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rovid.config import find_config, load_config, vehicle_of_tables
from rovid.errors import DataError
from rovid.identify.inertia import InertiaFit, fit_inertia, fit_inertia_table
from rovid.identify.steady import DragFit, fit_drag, points_from_table, steady_points
from rovid.parameters import Parameters
from rovid.readers import read_campaign
from rovid.report.evidence import Evidence
from rovid.report.page import write_report
from rovid.runs import Runs, prepare
from rovid.simulation import TrialSimulation, simulate_runs
from rovid.tables import SINE_COLUMNS, STEADY_COLUMNS, find_table, read_table
from rovid.vehicle import Vehicle


def build_report(stored: Parameters, paths: Sequence[Path], folder: Path, *, cutoff: float | None) -> Path:
    """Work the evidence out anew from the logs and write the page.

    Parameters that the file does not hold yet are fitted and written to it.

    Raises
    ------
    RovidError
        The logs or the configuration cannot be read, or the folder cannot be written.
    """
    evidence = _from_tables(stored, paths) or _from_logs(stored, paths, cutoff)
    if dict(evidence.parameters.entries) != dict(stored.entries) or not stored.path.exists():
        evidence.parameters.write()
    return write_report(folder, evidence)


def _from_tables(stored: Parameters, paths: Sequence[Path]) -> Evidence | None:
    steady, sine = find_table(paths, STEADY_COLUMNS), find_table(paths, SINE_COLUMNS)
    if steady is None and sine is None:
        return None
    vehicle = vehicle_of_tables(paths)
    drag = None if steady is None else fit_drag(points_from_table(read_table(steady)))
    if drag is not None and stored.drag() is None:
        stored = stored.with_estimate(drag.estimate)
    inertia = None
    if sine is not None:
        table = read_table(sine)
        inertia = fit_inertia_table(table, drag=stored.drag(), rigid_body=vehicle.rigid_body_inertia)
        if "inertia" not in stored.entries:
            stored = stored.with_estimate(inertia.estimate)
    return Evidence(
        vehicle=vehicle,
        parameters=stored,
        campaign=None,
        runs=None,
        drag=drag,
        drag_refusal="" if drag else "There is no table of steady states.",
        inertia=inertia,
        inertia_refusal="" if inertia else "There is no table of sine trials.",
        simulations=(),
    )


def _from_logs(stored: Parameters, paths: Sequence[Path], cutoff: float | None) -> Evidence:
    config = load_config(find_config(paths))
    campaign = read_campaign(paths, config)
    runs = prepare(campaign, config.vehicle, cutoff=cutoff)
    if not stored.logs:
        stored = stored.with_logs(paths, config.vehicle.name, campaign)
    drag, drag_refusal = _drag(runs, config.vehicle)
    if drag is not None and stored.drag() is None:
        stored = stored.with_estimate(drag.estimate)
    inertia, inertia_refusal = _inertia(runs, stored, config.vehicle)
    if inertia is not None and "inertia" not in stored.entries:
        stored = stored.with_estimate(inertia.estimate)
    return Evidence(
        vehicle=config.vehicle,
        parameters=stored,
        campaign=campaign,
        runs=runs,
        drag=drag,
        drag_refusal=drag_refusal,
        inertia=inertia,
        inertia_refusal=inertia_refusal,
        simulations=_simulations(runs, stored),
    )


def _drag(runs: Runs, vehicle: Vehicle) -> tuple[DragFit | None, str]:
    try:
        return fit_drag(steady_points(runs.items, vehicle)), ""
    except DataError as error:
        return None, str(error)


def _inertia(runs: Runs, stored: Parameters, vehicle: Vehicle) -> tuple[InertiaFit | None, str]:
    try:
        return fit_inertia(runs.items, drag=stored.drag(), rigid_body=vehicle.rigid_body_inertia), ""
    except DataError as error:
        return None, str(error)


def _simulations(runs: Runs, stored: Parameters) -> tuple[TrialSimulation, ...]:
    if not {"inertia", "quadratic_drag"} <= set(stored.entries):
        return ()
    return tuple(simulate_runs(runs.items, stored.model()))
