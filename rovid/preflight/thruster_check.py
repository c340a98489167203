"""Whether each thruster of rovid.toml moves the vehicle at all, which way, and as much as its arm and curve promise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.preflight.raw_columns import RawColumn, SignalGuess
from rovid.preflight.thruster_guess import CommandEffect, command_effects
from rovid.trial.axis import Axis
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Of what the others do for each N m; less than this for sure is next to nothing.
_HARDLY = 0.2
# Standard errors that are beyond doubt.
_SURE = 3.0


@dataclass(frozen=True, kw_only=True)
class ThrusterCheck:
    """What the logs tell of one thruster.

    Attributes
    ----------
    name
        As in rovid.toml.
    sense
        Of its torque, or force, by arm and curve: it should push up.
    strength, error
        What it does for each N m beside the mean of all, with its standard error; 1 where arms and curves are right in
        proportion, NaN where nothing is told.
    """

    name: str
    observed: CommandEffect
    strength: float
    error: float

    @property
    def is_reversed(self) -> bool:
        """Whether it pushes the other way than rovid.toml says."""
        return self.observed.direction < 0

    @property
    def is_ineffective(self) -> bool:
        """Whether it hardly does anything, for sure."""
        return abs(self.strength) + _SURE * self.error < _HARDLY

    def text(self, axis: Axis) -> str:
        """A sentence where something is wrong; else empty."""
        if self.is_reversed:
            return (
                f"Turn {axis.arm_key} of {self.name} around, or mend what its command is mapped to: more of its "
                f"{axis.force_name} makes the {axis.position_words} fall ({self.observed.text})."
            )
        if self.is_ineffective:
            return (
                f"Leave {self.name} out, or look at its {axis.arm_key}, curve and command: it {axis.motion_verb} the vehicle by "
                f"{100.0 * self.strength:.0f} ± {100.0 * self.error:.0f} % of what the others make expect."
            )
        return ""


def check_thrusters(trials: Sequence[Trial], vehicle: Vehicle) -> list[ThrusterCheck]:
    """Each thruster, held against the motion in ``trials``; none where nothing drives them."""
    names = [thruster.name for thruster in vehicle.thrusters]
    logs = list(_seen(trials, vehicle))
    if not names or not logs:
        return []
    measured = SignalGuess(source="", reason="", unit="rad" if vehicle.axis.angular else "m")
    told = command_effects(dict.fromkeys(names, 0.0), logs, measured, rights=vehicle.axis.self_righting)
    errors = {name: abs(one.gain / one.t_statistic) if one.t_statistic else np.inf for name, one in told.items()}
    weights = np.array([errors[name] ** -2.0 for name in names])
    effects = np.array([told[name].gain for name in names])
    usual = float(weights @ np.abs(effects)) / max(float(weights.sum()), 1e-300)
    return [
        ThrusterCheck(
            name=name,
            observed=told[name],
            strength=told[name].gain / usual if usual > 0.0 else np.nan,
            error=errors[name] / usual if usual > 0.0 else np.nan,
        )
        for name in names
    ]


def _seen(trials: Sequence[Trial], vehicle: Vehicle) -> Iterator[dict[str, RawColumn]]:
    for trial in trials:
        log = {"": RawColumn(source="", time=trial.time, values=trial.position)}
        for thruster, command in zip(vehicle.thrusters, trial.commands.T, strict=True):
            log[thruster.name] = RawColumn(source=thruster.name, time=trial.time, values=thruster.torque(command))
        yield log
