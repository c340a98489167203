"""Input and result of an exporter."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.export.body_equation import BodyEquation, Scheme, yaw_equation
from rovid.model.model import Model
from rovid.store.parameter_file import Entry, Parameters
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions
from rovid.trial.vehicle import Thruster, Vehicle

# s, for which each command of the verification is held; a multiple of the integration step of every simulator.
PERIOD = 0.1
# kg, stand-in for an unknown mass. Simulators refuse a mass of zero; yaw motion does not depend on it.
_STAND_IN_MASS = 1.0
# rad/s, largest yaw rate without logs.
_ASSUMED_RATE = 0.3

# The simulator's equation of motion, integrated as the simulator does: (n, k) commands, each held for `PERIOD` -> (n,)
# yaw rate in rad/s at the beginning of each, from rest, positive where the heading grows.
Simulate = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportInput:
    """Model and vehicle to export."""

    model: Model
    vehicle: Vehicle
    entries: Mapping[str, Entry]  #: Parameters with units and standard errors.
    largest_rate: float  #: rad/s, largest yaw rate in the logs.
    commands: FloatArray  #: (k, 2) smallest and largest command of each thruster in the logs.
    reference: Mapping[str, float]  #: Median of each further channel of the logs.
    #: ``heading_noise``, ``torque_in_use``: of the logs, in rad and N m; None without logs.
    heading_noise: float | None = None
    torque_in_use: float | None = None
    notes: tuple[str, ...] = ()  #: Assumptions about the vehicle and its trials.
    guess: Assumptions = field(default_factory=Assumptions)  #: Arms and curves that were not measured.

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """Parameters of each effect, by the key of the effect."""
        found = {}
        for effect in self.model.effects:
            names = [parameter.name for parameter in effect.parameters]
            found[effect.key] = {name: self.entries[f"{effect.key}.{name}"].value for name in names}
        return found

    def value(self, key: str, name: str) -> float:
        """Parameter ``name`` of the effect ``key``; 0 if the model is without the effect."""
        return self.effects.get(key, {}).get(name, 0.0)

    @property
    def mass(self) -> float:
        """Mass in kg, or a stand-in."""
        return self.vehicle.mass or _STAND_IN_MASS

    @property
    def rigid_inertia(self) -> float:
        """Inertia of the rigid body in kg m^2; the whole inertia if not known or larger than that."""
        rigid = self.vehicle.rigid_body_inertia
        if rigid is None or rigid > self.model.inertia:
            return self.model.inertia
        return rigid

    @property
    def added_inertia(self) -> float:
        """Added inertia in kg m^2."""
        return self.model.inertia - self.rigid_inertia

    def equation(self, step: float, scheme: Scheme = Scheme.RUNGE_KUTTA, **terms: Any) -> BodyEquation:
        """The base model's equation of yaw, in steps of ``step`` s; ``terms`` as in `yaw_equation`."""
        own = {"inertia": self.model.inertia, "linear": self.model.linear_drag, "quadratic": self.model.quadratic_drag}
        return yaw_equation(**(own | terms), step=step, scheme=scheme)

    @property
    def drag_terms(self) -> dict[str, Any]:
        """Cubic drag and drag asymmetry, as terms of `equation`."""
        ratio = self.value("drag_asymmetry", "ratio")
        return {"cubic": self.value("drag_curvature", "cubic"), "ratio": ratio or 1.0}

    def with_effects(self, keys: frozenset[str]) -> Model:
        """The model with only these effects."""
        kept = tuple(effect for effect in self.model.effects if effect.key in keys)
        values = [value for effect in kept for value in self.effects[effect.key].values()]
        return replace(self.model, effects=kept, effect_values=tuple(values))


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportResult:
    """Content of an exported file, and the simulator's equation with the numbers in it."""

    content: str | bytes
    simulate: Simulate | None  #: None where the file holds no model of the vehicle.
    equation: BodyEquation  #: The simulator's equation for the verdict on stability.
    kept_effects: frozenset[str]  #: Keys of the effects that the file represents.
    #: (parameter, reason) of the parts of the base model that the file cannot represent.
    base_losses: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()  #: Assumptions, and facts that the user has to know.


def export_input(stored: Parameters, study: Study | None) -> ExportInput:
    """Input from a parameter file and, if they exist, from the logs behind it.

    Raises ConfigError if the file holds no inertia or drag.
    """
    model = stored.model()
    vehicle = Vehicle(name=stored.vehicle or "vehicle", thrusters=()) if study is None else study.vehicle
    # An effect whose channel is not logged is evaluated at 1.
    reference = {channel: 1.0 for effect in model.effects for channel in effect.needs}
    if study is not None and study.runs is not None and study.campaign is not None:
        study.require_effects(model.effects)
        trials = study.campaign.trials
        commands = np.concatenate([trial.commands for trial in trials])
        return ExportInput(
            model=model,
            vehicle=vehicle,
            entries=stored.entries,
            largest_rate=max(float(np.nanmax(np.abs(run.rates.rate))) for run in study.runs.items),
            commands=np.column_stack([np.nanmin(commands, axis=0), np.nanmax(commands, axis=0)]),
            reference=reference | dict(trials[0].reference),
            heading_noise=study.position_noise(),
            torque_in_use=study.median_torque(),
        )
    largest = float(model.drag(np.array(_ASSUMED_RATE)))
    thruster = Thruster(name="yaw_torque", arm=1.0, curve=None, max_logged_torque=largest)
    note = (
        f"There are no logs of the yaw rate and the thrusters. A largest yaw rate of {_ASSUMED_RATE:g} rad/s is "
        "assumed, and the yaw torque itself is the command."
    )
    return ExportInput(
        model=model,
        vehicle=replace(vehicle, thrusters=(thruster,)),
        entries=stored.entries,
        largest_rate=_ASSUMED_RATE,
        commands=np.array([[-largest, largest]]),
        reference=reference,
        notes=(note,),
    )
