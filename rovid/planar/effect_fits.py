"""Effects that the planar model can hold, its fits with further ones, and places of sensors that rovid.toml lacks."""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.formatting import plus_minus, round_to_error
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import ANGLE_FORMS, PLANAR_FORMS, Effect, effect_named, forms_for, in_angles
from rovid.effects.base import Actuating, Coupling, SensorPlace, WaterCurrent
from rovid.estimate.estimate import Estimate
from rovid.estimate.fisher_information import inverse_information
from rovid.planar.dataset import PlanarData, has_hidden_sway
from rovid.planar.free_runs import FreeRuns, misses_much
from rovid.planar.likelihood import PlanarLikelihood
from rovid.planar.model import PlanarModel
from rovid.planar.optimum import Linearisation, PlanarOptimum, chord_fit
from rovid.planar.start_values import start_values, with_rudders_of
from rovid.planar.uncertainty import with_variance

# Effects that a vehicle with a rudder is likely to have, because its hull moves ahead: lift in proportion to the speed
# (Fossen 2011, section 6.4.2). Least gain in nats beyond the BIC penalty for which they are part of the base model.
HULL_LIFT, _LIFT_GAIN = ("sway_yaw_damping:lift", "speed_dependent_damping:planar"), 10.0
# Least predicted gain of a sensor's place, over that of the lift, for a fit: score tests are good to a factor of a few.
_PLACE_SHARE = 0.1
# Steps of the fits of a hull: by simulations, then by the filter.
_SIMULATED, _FILTERED = 30, 15
# Stall angles in rad from which its fit may start.
_STALLS = (0.3, 0.45, 0.85)
# Places of the linear and quadratic drags of sway and yaw among the coordinates.
_ACROSS = (5, 6, 8, 9)
# Forces of third order of a ship's hull, and the usual mass over density, squared length and half the draught.
SHIP, _SHIP_MASS = "cross_flow_drag:ship", 0.31
# Largest and standard relative error of these forces, by the scatter of published derivatives between tankers.
_SHAPE_ERROR = 0.25
SHIP_WARNING = (
    "The forces of third order of the hull have the shape of published tankers, with an error of "
    f"{100 * _SHAPE_ERROR:.0f} %. Turns that are much tighter than those in the logs depend on them."
)


def with_hull_lift(best: PlanarOptimum, data: PlanarData) -> PlanarOptimum:
    """The model with the lift of the hull, or of a ship, and with the stall angle of rudders, where they show."""
    return _with_stall(_with_lift(best, data), data)


def in_own_time(best: PlanarOptimum) -> PlanarOptimum:
    """The same model, whose time constant of yaw is the unit of the times of further effects."""
    return replace(best, likelihood=best.likelihood.with_coordinates(best.coordinates.with_time_of(best.model)))


def _with_stall(best: PlanarOptimum, data: PlanarData) -> PlanarOptimum:
    """The model with the stall angles that rovid.toml leaves open, if they improve the fit as the lift has to.

    A ship's model has none: small zigzags do not show it, and wider turns would depend on it. Where the model misses
    much, its likelihood does not tell a stall angle from other errors.
    """
    numbers = [at for at, rudder in enumerate(data.actuators.rudders) if rudder.stall is None]
    is_ship = any(rudder.straightening is not None for rudder in best.coordinates.rudders)
    if not numbers or not best.coordinates.rudders or best.likelihood.grid.yaw_only or is_ship:
        return best
    coordinates, x, places = best.coordinates.stalling(best.x, numbers)
    likelihood, found = best.likelihood.with_coordinates(coordinates), list[PlanarOptimum]()
    # A stall angle has no influence beyond the angles of attack in the logs: several values are tried by short fits.
    for angle in _STALLS:
        start = x.copy()
        start[places] = angle
        begin = PlanarOptimum(likelihood, start, likelihood.value(start))
        with suppress(DataError):  # Next to this start the filter diverges.
            found.append(chord_fit(likelihood, start, Linearisation.of(begin).matrix))
    needed = _LIFT_GAIN + 0.5 * math.log(float(best.likelihood.grid.used.sum())) * len(numbers)
    begin = min((best, *found), key=lambda one: one.value)
    if best.value - begin.value < THRESHOLDS.screening_share * needed:
        return best
    # A wrong stall angle bends all parameters of a rudder: the fit takes all its steps.
    stalling = _fitted(likelihood, FreeRuns.of(data, coordinates.sizes), begin.x)
    stalling = PlanarOptimum.fit(likelihood, stalling.x)
    return stalling if best.value - stalling.value > needed and not misses_much(stalling, data) else best


def _with_lift(best: PlanarOptimum, data: PlanarData) -> PlanarOptimum:
    if not best.coordinates.rudders or best.likelihood.grid.yaw_only:
        return best
    coordinates, x = best.coordinates, best.x
    for effect in map(effect_named, HULL_LIFT):
        x = np.insert(x, coordinates.noise_begin, np.zeros(len(effect.parameters)))
        coordinates = coordinates.with_effect(effect)
    likelihood = best.likelihood.with_coordinates(coordinates)
    penalty = 0.5 * math.log(float(best.likelihood.grid.used.sum()))
    if best.is_white and not best.limited.any():
        # A score test (Rao 1948) of a model that explains its logs costs less than the fits.
        gradient, information = likelihood.equations(x)
        gain = 0.5 * float(gradient @ inverse_information(information) @ gradient)
        needed = _LIFT_GAIN + penalty * (coordinates.noise_begin - best.coordinates.noise_begin)
        if gain < THRESHOLDS.screening_share * needed:
            return best
    runs = FreeRuns.of(data, coordinates.sizes)
    found = _fitted(likelihood, runs, x)

    def score(one: PlanarOptimum) -> float:
        size = one.value + penalty * np.count_nonzero(one.likelihood.free)
        return float(size if one is best else size + _LIFT_GAIN)

    lifted = min((best, found, _as_ship(found, runs)), key=score)
    if lifted is best:
        return best
    # The place of a sensor that rovid.toml lacks looks like lift: what has fewer parameters comes first.
    least = _PLACE_SHARE * (best.value - lifted.value)
    placed = [add_effect(best, one, data) for one in _unknown_places(data) if _predicted_gain(best, one) >= least]
    return best if any(score(one) <= score(lifted) for one in placed) else lifted


def _unknown_places(data: PlanarData) -> list[Effect]:
    """Places of sensors that rovid.toml lacks."""
    return [effect for effect in planar_candidates(data) if isinstance(effect.acts, SensorPlace)]


def _predicted_gain(best: PlanarOptimum, place: Effect) -> float:
    """Gain of log-likelihood (nats) by the ``place`` of a sensor, by the score test (Rao 1948)."""
    count, at = len(place.parameters), best.coordinates.noise_begin
    likelihood = replace(best.likelihood, free_runs=None, coordinates=best.coordinates.with_effect(place))
    gradient, information = likelihood.equations(np.insert(best.x, at, np.zeros(count)))
    rest = np.delete(np.arange(len(gradient)), range(at, at + count))
    with_place, without = (
        0.5 * float(gradient[own] @ inverse_information(information[np.ix_(own, own)]) @ gradient[own])
        for own in (np.arange(len(gradient)), rest)
    )
    return with_place - without


def _fitted(likelihood: PlanarLikelihood, runs: FreeRuns | None, x: FloatArray) -> PlanarOptimum:
    """The likeliest model near the one that simulates the ``runs`` best: simulations are cheaper than the filter."""
    if runs is None:
        return PlanarOptimum.fit(likelihood, x, _FILTERED)
    simulating = PlanarOptimum.fit(replace(likelihood, free_runs=runs), x, _SIMULATED).x
    if not has_hidden_sway(runs.data):
        return PlanarOptimum.fit(likelihood, simulating, _FILTERED)
    # Simulations say little about a sway that is not measured: the likelihood decides between both starts.
    return min((PlanarOptimum.fit(likelihood, one) for one in (x, simulating)), key=lambda one: one.value)


def _as_ship(lifted: PlanarOptimum, runs: FreeRuns | None) -> PlanarOptimum:
    """The fit of a ship's model, from that with the lift of the hull.

    The hull has damping in proportion to its speed, and the forces of third order of `cross_flow_drag:ship` in place of
    its quadratic drags across the flow. The flow at the rudders is straightened.
    """
    begin, base = lifted.coordinates.effects_begin, lifted.model.base
    coordinates, x = lifted.coordinates.straightened(lifted.x)
    begin += len(x) - len(lifted.x)
    # The linear drags at the usual speed, as damping in proportion to it.
    of_speed = base[[6, 5]] / float(coordinates.sizes.speed[0])
    x[begin + 2 : begin + 4] += of_speed / coordinates.units[begin + 2 : begin + 4]
    length = 2.0 * max(abs(one.position[0]) for one in coordinates.rudders)
    at = coordinates.noise_begin
    coordinates = coordinates.with_effect(effect_named(SHIP))
    own = np.array([base[0] / (_SHIP_MASS * length**2), length]) / coordinates.units[at : at + 2]
    usual, given = own.tolist()
    limits = {at: ((1.0 - _SHAPE_ERROR) * usual, (1.0 + _SHAPE_ERROR) * usual), at + 1: (given, given)}
    coordinates = coordinates.bounded(limits | dict.fromkeys(_ACROSS, (0.0, 0.0)))
    return _fitted(lifted.likelihood.with_coordinates(coordinates), runs, np.insert(x, at, own))


def with_shape_error(model: PlanarModel, covariance: FloatArray) -> FloatArray:
    """(q, q) ``covariance`` of a ship, with the error of the shape as that of the forces of third order."""
    at = model.names.index(f"{SHIP}.coefficient")
    return with_variance(covariance, at, float((_SHAPE_ERROR * model.values[at]) ** 2))


def add_effect(base: PlanarOptimum, effect: Effect, data: PlanarData) -> PlanarOptimum:
    """The best fit with one more effect, from each of its initial values.

    Raises DataError if the effect couples surge and sway, and neither is measured.
    """
    if base.likelihood.grid.yaw_only and isinstance(effect.acts, Coupling | WaterCurrent):
        mend = "Map surge_velocity and sway_velocity, or north and east, in [signals] of rovid.toml."
        raise DataError("these logs measure the heading alone.", where=effect.key, mend=mend)
    return base.with_effect(effect, _new_starts(base, effect, data))


def _new_starts(base: PlanarOptimum, effect: Effect, data: PlanarData) -> list[FloatArray]:
    """Coordinates with a current, or with the place of the sensors of the speeds, from the regressions; else none.

    Both change every parameter. So the base parameters start anew, too.
    """
    # With a velocity log the regressions have no speeds of the antenna.
    read = ("north", "east") if "surge_velocity" not in data.sensors else ("surge_velocity", "sway_velocity")
    of_speeds = isinstance(effect.acts, SensorPlace) and effect.acts.sensors == read
    if not isinstance(effect.acts, WaterCurrent) and not of_speeds:
        return []
    coordinates, starts = base.coordinates, []
    at, size = coordinates.noise_begin, coordinates.sizes.effects.unit_size(effect.parameters[0])
    known = base.model.current
    for start in start_values(data, with_current=not of_speeds, with_place=of_speeds, known=known):
        north, east = start.current
        own = effect.initial_values[0].copy()
        if of_speeds:
            own = np.array([start.place / size, 0.0])
        else:
            own[:2] = max(math.hypot(north, east) / size, 0.02), math.atan2(east, north)
        effects = [one.parameters for one in base.model.effects]
        anew = coordinates.initial(with_rudders_of(base.model, start.model), effects)
        # The disturbance and the noise of a model without it say nothing.
        starts.append(np.concatenate((anew[:at], own, anew[at:])))
    return starts


def is_of_actuators(effect: Effect) -> bool:
    """Whether the coupled model holds the effect between commands and forces; what acts in yaw alone is a coupling."""
    return isinstance(effect.acts, Actuating) and effect.axes != ("yaw",)


def planar_candidates(data: PlanarData) -> tuple[Effect, ...]:
    """All forms that the planar model can hold and these logs can show."""
    channels = set.intersection(*(set(run.trial.extras) for run in data.runs))
    acting = forms_for(data.actuators.thrusters, channels, [run.name for run in data.runs])
    actuators = [form for form in acting if is_of_actuators(form) and not form.instants]
    if data.actuators.steered:
        actuators = [form for form in actuators if in_angles(form) is form]
    actuators += ANGLE_FORMS if len(data.actuators.angle_columns) else ()
    if not {"surge_velocity", "sway_velocity", "north", "east"} & set(data.sensors):
        return tuple(actuators)
    found = []
    for form in PLANAR_FORMS:
        unplaced = not isinstance(form.acts, SensorPlace) or {*form.acts.sensors} <= {*data.sensors} - data.placed
        if unplaced and (form.key != SHIP or data.actuators.rudders):
            found.append(form)
    return (*found, *actuators)


def place_entries(estimate: Estimate, effects: tuple[Effect, ...], gain: float = 0.0) -> Iterator[str]:
    """For each place among ``effects`` in the ``estimate``, the entry of rovid.toml; with a ``gain`` as a proposal."""
    for effect in effects:
        if not isinstance(effect.acts, SensorPlace):
            continue
        pairs = [(estimate.value(name), estimate.standard_error(name)) for name in effect.parameter_names]
        (ahead, starboard), (x, y) = ([one(*pair) for pair in pairs] for one in (plus_minus, round_to_error))
        words = effect.title.removeprefix("place of the ")
        begin = f"The log-likelihood grows by {gain:.0f} with the {words}" if gain else f"The model has the {words}"
        test = " `rovid diagnose --axes planar` compares this with other causes." if gain else ""
        yield (
            f"{begin} {ahead} m ahead and {starboard} m to starboard of the origin. Measure its place, and write "
            f"position = [{x}, {y}] at {' and '.join(effect.acts.sensors)} in [signals] of rovid.toml.{test}"
        )


def proposed_places(best: PlanarOptimum, data: PlanarData) -> Iterator[str]:
    """Entries of rovid.toml for places that would improve a fit which misses something."""
    has_place = any(isinstance(effect.acts, SensorPlace) for effect in best.effects)
    if has_place or best.likelihood.grid.yaw_only or (best.is_white and not best.limited.any()):
        return
    penalty = 0.5 * math.log(float(best.likelihood.grid.used.sum()))
    for effect in _unknown_places(data):
        needed = THRESHOLDS.bic_margin + penalty * len(effect.parameters)
        if _predicted_gain(best, effect) < needed:
            continue
        plain = PlanarOptimum.fit(replace(best.likelihood, free_runs=None), best.x) if best.is_multi_step else best
        placed = add_effect(plain, effect, data)
        # Where each disturbance stays at its limit, the place stands for something else that the model misses.
        explains = placed.is_white or placed.limited.sum() < plain.limited.sum()
        if explains and plain.value - placed.value > needed:
            yield from place_entries(placed.effect_estimate(effect), (effect,), plain.value - placed.value)
