"""The catalogue of log faults: one file a fault, named by its id in `rovid.trial.fault`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib import import_module

from rovid.faults.base import FaultKind, RunsData, Stage, examine
from rovid.trial.fault import FAULT_IDS, Fault, FaultOverrides
from rovid.trial.preprocessing import Run
from rovid.trial.vehicle import Vehicle


def examine_runs(
    runs: Sequence[Run], vehicle: Vehicle, overrides: FaultOverrides
) -> tuple[tuple[Run, ...], tuple[Fault, ...]]:
    """The runs that stay after the remedies, and the faults that torque and rates show."""
    data, faults = examine(fault_kinds("runs"), RunsData(runs=runs, vehicle=vehicle), overrides)
    return tuple(data.runs), faults


@cache
def fault_kinds(stage: Stage) -> tuple[FaultKind, ...]:
    """Kinds of faults that are looked for at ``stage``; a fault that shows at two stages has ``FURTHER`` kinds."""
    modules = [import_module(f"rovid.faults.{name}") for name in FAULT_IDS]
    kinds: list[FaultKind] = [kind for module in modules for kind in (module.FAULT, *getattr(module, "FURTHER", ()))]
    return tuple(kind for kind in kinds if kind.stage == stage)
