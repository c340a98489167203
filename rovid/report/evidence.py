"""Everything that a report shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rovid.campaign.axis import Axis
from rovid.campaign.trial import Campaign
from rovid.campaign.vehicle import Vehicle
from rovid.control.loop_design import Control
from rovid.diagnose.record import Diagnosis, Side
from rovid.export.exporting import Exported
from rovid.identify.inertia import InertiaFit
from rovid.identify.steady import DragFit
from rovid.model.simulation import TrialSimulation
from rovid.motion.runs import Runs
from rovid.parameters.parameters import Parameters
from rovid.report.stages import Stage


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
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
    runs: Runs | None
    drag: DragFit | None
    drag_refusal: str
    inertia: InertiaFit | None
    inertia_refusal: str
    simulations: tuple[TrialSimulation, ...]
    stages: tuple[Stage, ...] = ()
    diagnosis: Diagnosis | None = None
    diagnosis_refusal: str = ""
    control: Control | None = None
    control_refusal: str = ""
    exports: Mapping[str, Exported] | None = None
    export_refusal: str = ""
    notes: tuple[str, ...] = ()

    @property
    def axis(self) -> Axis:
        """The degree of freedom that the page is about."""
        return self.vehicle.axis

    @property
    def before(self) -> tuple[TrialSimulation, ...]:
        """Every trial simulated without what was found; by the model where nothing was looked for."""
        return self.stages[0].simulations if self.stages else self.simulations

    @property
    def after(self) -> tuple[TrialSimulation, ...]:
        """The same with all that was found."""
        return self.stages[-1].simulations if self.stages else self.simulations

    @property
    def found(self) -> Side | None:
        """The model with what was found; None where nothing was."""
        side = self.diagnosis.extended if self.diagnosis else None
        return side if side is not None and side.model.effects else None
