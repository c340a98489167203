"""Everything that a report shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rovid.campaign.axis import Axis
from rovid.campaign.trial import Campaign
from rovid.campaign.vehicle import Vehicle
from rovid.control.loop_design import Control
from rovid.diagnose.record import Diagnosis
from rovid.export.exporting import Exported
from rovid.identify.inertia import InertiaFit
from rovid.identify.steady import DragFit
from rovid.model.simulation import TrialSimulation
from rovid.motion.runs import Runs
from rovid.parameters.parameters import Parameters


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """What the logs gave; where something is missing its refusal says why.

    ``parameters`` are the one model's, and ``simulations`` its. ``campaign`` and ``runs`` are None where tables stood
    in place of logs. ``diagnosis`` is None where there was none: with a refusal it was not possible, without one it was
    not wanted. ``before`` is in step with ``simulations``, the same trials simulated by the plain model, without what
    was found, and empty where nothing was; ``compared`` is one trial, simulated without and with it. ``control`` and
    ``exports``, by the format's name, are None as ``diagnosis`` is, and along other axes than yaw. ``notes`` tell how
    the parameter file stood.
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
    before: tuple[TrialSimulation, ...] = ()
    diagnosis: Diagnosis | None = None
    diagnosis_refusal: str = ""
    compared: tuple[TrialSimulation, TrialSimulation] | None = None
    control: Control | None = None
    control_refusal: str = ""
    exports: Mapping[str, Exported] | None = None
    export_refusal: str = ""
    notes: tuple[str, ...] = ()

    @property
    def axis(self) -> Axis:
        """The degree of freedom that the page is about."""
        return self.vehicle.axis
