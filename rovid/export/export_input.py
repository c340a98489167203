"""What is exported: the model, its vehicle, and what the logs say of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import Effect
from rovid.model.model import Model
from rovid.signals.preprocessing import PreparedRuns
from rovid.store.parameter_file import Entry, Parameters
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions
from rovid.trial.trial import Campaign
from rovid.trial.vehicle import Thruster, Vehicle

_SDF_MASS = 1.0  # kg, where none is known: a mass of zero is refused, and yaw does not ask for it
_ASSUMED_RATE = 0.3  # rad/s, where no log says how fast it turned


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportInput:
    """What is exported.

    Attributes
    ----------
    entries
        The parameter file's, with unit and standard error.
    largest_rate
        rad/s; the yaw rates that the parameters rest on.
    commands
        (k, 2) smallest and largest command in use of each of the vehicle's thrusters.
    reference
        Median of each further channel of the logs.
    notes
        What was not known of the vehicle and its trials.
    guess
        What of the thrusters behind the parameters is no measurement.
    """

    model: Model
    vehicle: Vehicle
    entries: Mapping[str, Entry]
    largest_rate: float
    commands: FloatArray
    reference: Mapping[str, float]
    notes: tuple[str, ...] = ()
    guess: Assumptions = field(default_factory=Assumptions)

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """Parameters of each effect of the model by its key."""
        found = {}
        for effect in self.model.effects:
            names = [parameter.name for parameter in effect.parameters]
            found[effect.key] = {name: self.entries[f"{effect.key}.{name}"].value for name in names}
        return found

    @property
    def mass(self) -> float:
        """Mass in kg; a stand-in where the vehicle's is not known."""
        return self.vehicle.mass or _SDF_MASS

    @property
    def rigid_inertia(self) -> float:
        """Inertia in kg m^2 of the body without the water; all where that is not known, or not below the whole."""
        rigid = self.vehicle.rigid_body_inertia
        if rigid is None or rigid > self.model.inertia:
            return self.model.inertia
        return rigid

    @property
    def added_inertia(self) -> float:
        """Inertia in kg m^2 of the water that turns with the body."""
        return self.model.inertia - self.rigid_inertia

    def with_effects(self, keys: frozenset[str]) -> Model:
        """The model with these effects alone."""
        kept = tuple(effect for effect in self.model.effects if effect.key in keys)
        return replace(self.model, effects=kept, effect_values=self.effect_values(kept))

    def effect_values(self, effects: Sequence[Effect]) -> tuple[float, ...]:
        """Parameters of these ``effects`` of the model, one after the other."""
        values = self.effects
        return tuple(value for effect in effects for value in values[effect.key].values())


def export_input(stored: Parameters, study: Study | None) -> ExportInput:
    """What a parameter file, and the logs that it remembers where they are there, say of the vehicle.

    Raises
    ------
    ConfigError
        The file holds no inertia or drag.
    """
    model = stored.model()
    if study is None:
        return _without_logs(stored, model, Vehicle(name=stored.vehicle or "vehicle", thrusters=()))
    if study.runs is None or study.campaign is None:
        return _without_logs(stored, model, study.vehicle)
    study.require_effects(model.effects)
    return ExportInput(
        model=model,
        vehicle=study.vehicle,
        entries=stored.entries,
        largest_rate=_largest_rate(study.runs),
        commands=_commands_in_use(study.campaign),
        reference=_channels(model, study.campaign.trials[0].reference),
    )


def _without_logs(stored: Parameters, model: Model, vehicle: Vehicle) -> ExportInput:
    """One thruster that gives the yaw torque itself, as much as holds the assumed rate."""
    largest = float(model.drag(np.array(_ASSUMED_RATE)))
    torque = Thruster(name="yaw_torque", arm=1.0, curve=None, max_logged_torque=largest)
    note = (
        f"No logs say how fast the vehicle turned or what its thrusters are: {_ASSUMED_RATE:g} rad/s is assumed, and "
        "the yaw torque itself is the command."
    )
    return ExportInput(
        model=model,
        vehicle=replace(vehicle, thrusters=(torque,)),
        entries=stored.entries,
        largest_rate=_ASSUMED_RATE,
        commands=np.array([[-largest, largest]]),
        reference=_channels(model, {}),
        notes=(note,),
    )


def _largest_rate(runs: PreparedRuns) -> float:
    """rad/s."""
    largest = [float(np.nanmax(np.abs(run.rates.rate))) for run in runs.items]
    return max(largest)


def _commands_in_use(campaign: Campaign) -> FloatArray:
    """(k, 2) smallest and largest command of each thruster."""
    commands = np.concatenate([trial.commands for trial in campaign.trials])
    return np.column_stack([np.nanmin(commands, axis=0), np.nanmax(commands, axis=0)])


def _channels(model: Model, reference: Mapping[str, float]) -> dict[str, float]:
    """Median of each further channel; one that an effect needs and no log has is taken to be one."""
    needed: dict[str, float] = {}
    for effect in model.effects:
        needed |= dict.fromkeys(effect.needs, 1.0)
    return needed | dict(reference)
