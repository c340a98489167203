"""Causes of a diagnosis of yaw that the coupled model of surge, sway and yaw explains."""

from __future__ import annotations

from collections.abc import Iterable

from rovid.diagnose.result import Diagnosis
from rovid.effects.actuator_inputs import SPEEDS
from rovid.trial.axis import YAW
from rovid.trial.trial import Trial

# Effects of yaw that stand for motion along surge and sway, which the coupled model has as states.
_OF_MOTION = ("sideslip_moment", "speed_dependent_damping")
# Effects that slow motion along sway may imitate; they count next to one of the former alone.
_IMITATED = ("wave_torque", "heading_dependent_torque")
_POSITIONS = {"north", "east"}


def coupled_causes(diagnosis: Diagnosis, trials: Iterable[Trial]) -> tuple[str, ...]:
    """Ids of findings that the coupled model would explain; none if no speed or position is logged."""
    every = list(trials)
    logged = [set(trial.extras) | set(trial.readings) for trial in every]
    if not every or any(trial.axis is not YAW for trial in every):
        return ()
    if not all(SPEEDS[1] in names or names >= _POSITIONS for names in logged):
        return ()
    found = [one.effect.id for one in diagnosis.findings]
    if not any(name in _OF_MOTION for name in found):
        return ()
    return tuple(name for name in found if name in _OF_MOTION or name in _IMITATED)


def coupled_sentence(diagnosis: Diagnosis, trials: Iterable[Trial]) -> str:
    """Recommendation of the coupled model; empty where the diagnosis gives no reason for it."""
    coupled, count = coupled_causes(diagnosis, trials), len(diagnosis.findings)
    if not coupled:
        return ""
    share = f"{len(coupled)} of {count} causes are" if count > 1 else "The cause is"
    return f"{share} motion along surge and sway: run `rovid diagnose --axes planar`, which fits it together with yaw."
