"""Everything that a report shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rovid.axis import Axis
from rovid.control.design import Control
from rovid.diagnose.diagnosis import Diagnosis
from rovid.export import Exported
from rovid.identify.inertia import InertiaFit
from rovid.identify.steady import DragFit
from rovid.parameters import Parameters
from rovid.runs import Runs
from rovid.simulation import TrialSimulation
from rovid.trial import Campaign
from rovid.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """What the logs gave; where something is missing its refusal says why.

    ``campaign`` and ``runs`` are None where tables stood in place of logs. ``diagnosis`` is None where there was none:
    with a refusal it was not possible, without one it was not wanted. ``compared`` is one trial, simulated without and
    with what it found. ``control`` and ``exports``, by the format's name, are None as ``diagnosis`` is, and along other
    axes than yaw.
    """

    vehicle: Vehicle
    parameters: Parameters
    campaign: Campaign | None
    runs: Runs | None
    drag: DragFit | None
    drag_refusal: str
    inertia: InertiaFit | None
    inertia_refusal: str
    simulations: tuple[TrialSimulation, ...]
    diagnosis: Diagnosis | None = None
    diagnosis_refusal: str = ""
    compared: tuple[TrialSimulation, TrialSimulation] | None = None
    control: Control | None = None
    control_refusal: str = ""
    exports: Mapping[str, Exported] | None = None
    export_refusal: str = ""

    @property
    def axis(self) -> Axis:
        """The degree of freedom that the page is about."""
        return self.vehicle.axis
