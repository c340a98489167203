"""The catalogue of log faults: one file a fault, named by its id in `rovid.trial.fault`."""

from collections.abc import Sequence
from functools import cache
from importlib import import_module

from rovid.faults.base import Detector, RunsData, Stage, examine
from rovid.trial.fault import FAULT_IDS, Fault, FaultOverrides
from rovid.trial.preprocessing import Run
from rovid.trial.vehicle import Vehicle


def examine_runs(
    runs: Sequence[Run], vehicle: Vehicle, overrides: FaultOverrides
) -> tuple[tuple[Run, ...], tuple[Fault, ...]]:
    """The runs that stay after the remedies, and the faults that torque and rates show."""
    data, faults = examine(detectors_at("runs"), RunsData(runs=runs, vehicle=vehicle), overrides)
    return tuple(data.runs), faults


@cache
def detectors_at(stage: Stage) -> tuple[Detector, ...]:
    """Detectors of all faults that are looked for at ``stage``; each file has a table ``DETECTORS``."""
    modules = [import_module(f"rovid.faults.{name}") for name in FAULT_IDS]
    return tuple(detect for module in modules for detect in module.DETECTORS.get(stage, ()))
