"""Effects that may explain what the planar model misses in given logs."""

from __future__ import annotations

from dataclasses import dataclass

from rovid.core.array_types import FloatArray
from rovid.effects import PLANAR_FORMS, Effect, forms_for
from rovid.effects.base import OnCommand, OnThrust, OnTorque
from rovid.planar.dataset import PlanarData


def planar_candidates(data: PlanarData) -> tuple[Effect, ...]:
    """All forms that the planar model can hold and these logs can show."""
    thrusters = data.actuators.thrusters
    channels = set.intersection(*(set(run.trial.extras) for run in data.runs))
    acting = forms_for(thrusters, channels, [run.name for run in data.runs])
    actuators = [form for form in acting if isinstance(form.acts, OnCommand | OnThrust | OnTorque)]
    if not {"surge_velocity", "sway_velocity", "north", "east"} & set(data.sensors):
        return tuple(actuators)
    return (*PLANAR_FORMS, *actuators)


@dataclass(frozen=True, eq=False)
class PlanarScoreTest:
    """Predicted gain of one form next to a model, by the score test (Rao 1948)."""

    effect: Effect
    gain: float  #: Nats.
    start: FloatArray  #: (k,) initial values of a fit, in units of the scales.
    detectable: float  #: Smallest distance of the first size from its neutral value that a search would add, SI.
