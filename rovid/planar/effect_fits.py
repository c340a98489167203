"""Effects that the planar model can hold, and its fits with further ones."""

import math
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.effects import PLANAR_FORMS, Effect, effect_named, forms_for
from rovid.effects.base import Coupling, OnCommand, OnThrust, OnTorque, WaterCurrent
from rovid.planar.dataset import PlanarData
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.start_values import start_values

# Effects that a vehicle with a rudder is likely to have, because its hull moves ahead: lift in proportion to the speed
# (Fossen 2011, section 6.4.2). Least gain in nats beyond the BIC penalty for which they are part of the base model.
HULL_LIFT, _LIFT_GAIN = ("sway_yaw_damping:lift", "speed_dependent_damping:planar"), 10.0


def with_hull_lift(best: PlanarOptimum) -> PlanarOptimum:
    """The model with the lift of the hull, for a vehicle with a rudder and where the lift shows; else ``best``."""
    if not best.coordinates.rudders or best.likelihood.grid.yaw_only:
        return best
    coordinates, x = best.coordinates, best.x
    for effect in map(effect_named, HULL_LIFT):
        x = np.insert(x, coordinates.noise_begin, np.zeros(len(effect.parameters)))
        coordinates = coordinates.with_effect(effect)
    found = PlanarOptimum.fit(best.likelihood.with_coordinates(coordinates), x)
    penalty = (
        0.5
        * math.log(float(best.likelihood.grid.used.sum()))
        * (coordinates.noise_begin - best.coordinates.noise_begin)
    )
    return found if best.value - found.value > penalty + _LIFT_GAIN else best


def add_effect(base: PlanarOptimum, effect: Effect, data: PlanarData) -> PlanarOptimum:
    """The best fit with one more effect, from each of its initial values.

    Raises DataError if the effect couples surge and sway, and neither is measured.
    """
    if base.likelihood.grid.yaw_only and isinstance(effect.acts, Coupling | WaterCurrent):
        raise DataError(
            "these logs measure the heading alone.",
            where=effect.key,
            mend="Map surge_velocity and sway_velocity, or north and east, in [signals] of rovid.toml.",
        )
    return base.with_effect(effect, _current_starts(base, effect, data))


def _current_starts(base: PlanarOptimum, effect: Effect, data: PlanarData) -> list[FloatArray]:
    """Coordinates with a current from the regressions; none for other effects.

    A current changes every parameter. So the base parameters start anew, too.
    """
    if not isinstance(effect.acts, WaterCurrent):
        return []
    coordinates, starts = base.coordinates, []
    at = coordinates.noise_begin
    for start in start_values(data, with_current=True):
        north, east = start.current
        own = effect.initial_values[0].copy()
        speed = coordinates.sizes.effects.unit_size(effect.parameters[0])
        own[:2] = max(math.hypot(north, east) / speed, 0.02), math.atan2(east, north)
        effects = [one.parameters for one in base.model.effects]
        anew = coordinates.initial(start.model, effects)
        # The disturbance and the noise of a model without the current say nothing.
        starts.append(np.concatenate((anew[:at], own, anew[at:])))
    return starts


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
