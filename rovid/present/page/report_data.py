"""Everything that a report shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rovid.control.design import ControllerDesign
from rovid.diagnose.result import Diagnosis, ModelAssessment
from rovid.estimate.inertia import InertiaFit
from rovid.estimate.steady_drag import DragFit
from rovid.export.run_export import VerifiedExport
from rovid.model.simulation import TrialSimulation
from rovid.present.page.nested_simulations import NestedSimulation
from rovid.signals.preprocessing import PreparedRuns
from rovid.store.parameter_file import Parameters
from rovid.trial.axis import Axis
from rovid.trial.trial import Campaign
from rovid.trial.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportData:
    """What the logs gave; where something is missing its refusal says why.

    ``parameters`` are the one model's, and ``simulations`` its. ``campaign`` and ``runs`` are None where tables stood
    in place of logs. ``diagnosis`` is None where there was none: with a refusal it was not possible, without one it was
    not wanted. ``stages`` has every trial simulated with none of what it found first, with all of it, the one model,
    last; it is empty without a diagnosis of logs. ``control`` and ``exports``, by the format's name, are None as
    ``diagnosis`` is, and along other axes than yaw. ``notes`` tell how the parameter file stood.
    """

    vehicle: Vehicle
    parameters: Parameters
    campaign: Campaign | None
    runs: PreparedRuns | None
    drag: DragFit | None
    drag_refusal: str
    inertia: InertiaFit | None
    inertia_refusal: str
    simulations: tuple[TrialSimulation, ...]
    nested: tuple[NestedSimulation, ...] = ()
    diagnosis: Diagnosis | None = None
    diagnosis_refusal: str = ""
    control: ControllerDesign | None = None
    control_refusal: str = ""
    exports: Mapping[str, VerifiedExport] | None = None
    export_refusal: str = ""
    notes: tuple[str, ...] = ()

    @property
    def axis(self) -> Axis:
        """The degree of freedom that the page is about."""
        return self.vehicle.axis

    @property
    def simulations_without(self) -> tuple[TrialSimulation, ...]:
        """Every trial simulated without what was found; by the model where nothing was looked for."""
        return self.nested[0].simulations if self.nested else self.simulations

    @property
    def simulations_with(self) -> tuple[TrialSimulation, ...]:
        """The same with all that was found."""
        return self.nested[-1].simulations if self.nested else self.simulations

    @property
    def extended(self) -> ModelAssessment | None:
        """The model with what was found; None where nothing was."""
        side = self.diagnosis.extended if self.diagnosis else None
        return side if side is not None and side.model.effects else None
