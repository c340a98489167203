"""Fit of the planar model to runs: maximum likelihood of the innovations of an extended Kalman filter."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.formatting import significant
from rovid.effects import Effect
from rovid.effects.base import SensorPlace, WaterCurrent
from rovid.estimate.estimate import Estimate
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2
from rovid.planar.coordinates import PlanarCoordinates
from rovid.planar.dataset import PlanarData, has_hidden_sway, is_pushed, is_yaw_alone, measured_axes, require_measured
from rovid.planar.effect_fits import (
    SHIP,
    SHIP_WARNING,
    add_effect,
    in_own_time,
    place_entries,
    proposed_places,
    with_hull_lift,
    with_shape_error,
)
from rovid.planar.free_runs import FreeRuns, better_simulating, free_run_r2, mean_free_run_r2
from rovid.planar.kernels import NOISE_SENSOR, NOISE_TIME
from rovid.planar.likelihood import PlanarLikelihood
from rovid.planar.model import AXIS_NAMES, SENSORS, PlanarModel
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.start_values import planar_grid, planar_sizes, start_values, with_own_sizes
from rovid.planar.uncertainty import (
    LOOSER,
    PriorUse,
    Undetermined,
    misfit_variance,
    parameter_scale,
    total_covariance,
    undetermined_directions,
    with_rigid_body,
    yaw_alone_covariance,
)

_METHOD = "maximum likelihood of the innovations of an extended Kalman filter, surge, sway and yaw together"
_METHOD_FREE_RUNS = "least squares of free-running simulations over some time constants, surge, sway and yaw together"
# Interval between the readings of a search in shares of the shortest time constant.
_SEARCH_SHARE = 0.12
# Steps of a start by free-running simulations, and of each start by the likelihood.
_START_ITERATIONS, _FIRST_ITERATIONS = 15, 4
# Starts by free-running simulations where the logs do not measure the sway, and steps of each by the likelihood.
_HIDDEN_STARTS, _HIDDEN_ITERATIONS = 3, 12
# Loss of mean free-running R^2 below the best start that a start may have to give the sizes.
_WORSE_START = 0.2
# Steps with all readings, after the search.
_LAST_ITERATIONS = 12
# Rounds in which stamps are moved by a latency, the least latency in time constants for a further round, and standard
# errors from zero of a latency that shows.
_LATENCY_ROUNDS, _LATENCY_TOLERANCE, _LATENCY_SIGMAS = 4, 0.01, 4.0
# Largest latency in the shortest time constant of the axes that a sensor measures, and in s: a DVL or a gyro answers at
# once, a USBL after the way of its sound and its radio link. A decision.
_MOST_LATENCY = 0.6
_MOST_SECONDS = np.array([5.0 if name in {"north", "east"} else 1.0 for name in SENSORS])
# Least rigid-body share of an inertia that is no warning: the thrust curve may be off.
_LEAST_RIGID = 0.9

_TURNS_ALONE = (
    "These runs turn the vehicle alone. Its hull sways freely in a turn: yaw.inertia is smaller than I by the square "
    "of sway_yaw.inertia over sway.inertia, which these runs do not determine."
)
_TOO_LIGHT = "the thrust curves promise less force than acts, the model misses a force, or the mass is wrong"
_DRIFTS = (
    "Thrusters push ahead or sideways, and neither speed is measured: the model lacks the torque of the hull's drift "
    "(Munk moment). The standard errors include those of yaw alone. A DVL or a position would determine it."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarFit:
    """A planar model with its uncertainty."""

    model: PlanarModel
    estimate: Estimate  #: Refused parameters have a value here that must not be printed.
    log_likelihood: float
    undetermined: tuple[Undetermined, ...] = ()
    noise: Mapping[str, float]  #: Sensor -> standard deviation of its white noise, SI and rad.
    #: Axis (surge, sway, yaw) -> standard deviation in N or N m, and correlation time in s, of the disturbance.
    disturbance: Mapping[str, tuple[float, float]]
    at_limit: tuple[str, ...] = ()  #: Axes with a disturbance at its upper limit.
    white: bool = True  #: Whether the normalised innovations are white.
    multi_step: bool = False  #: Whether multi-step predictions were fitted instead of innovations.
    #: Sensor -> latency in s and its standard error; only where it shows.
    latency: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    #: Axis -> R^2 of the free-running speed.
    free_run_r2: Mapping[str, float]
    prior: PriorUse = field(default_factory=PriorUse)

    @property
    def missing(self) -> str:
        """Clause on what the model misses; empty where it explains the logs but for chance."""
        poor = [f"{name} {value:.2f}" for name, value in self.free_run_r2.items() if value < INNOVATIONS_R2]
        if not poor or (self.white and not self.at_limit):
            return ""
        return f"the model misses something (R^2 of the free-running simulation: {', '.join(poor)})"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Full sentences."""
        return self.estimate.warnings


def fit_planar(data: PlanarData, effects: Sequence[Effect] = ()) -> PlanarFit:
    """Estimate the base model and ``effects`` from the innovations of an extended Kalman filter.

    Raises DataError if the runs are too short, nothing moves, or no sensor measures what an effect needs.
    """
    best = fit_all_readings(data, effects)
    fit = planar_result(data, best)
    warnings = (*proposed_places(best, data), *fit.estimate.warnings)
    return replace(fit, estimate=replace(fit.estimate, warnings=warnings))


def fit_all_readings(data: PlanarData, effects: Sequence[Effect] = ()) -> PlanarOptimum:
    """The best model of all readings; raises the same as `fit_planar`."""
    first = [effect for effect in effects if isinstance(effect.acts, WaterCurrent | SensorPlace)]
    best = fit_base(data, with_current=bool(first))
    # Without its current, and the places of its sensors, a vehicle has no model worth extending.
    for effect in first:
        best = add_effect(best, effect, data)
    best = in_own_time(with_hull_lift(best, data))
    for effect in effects:
        if effect.key not in {one.key for one in best.effects}:
            best = add_effect(best, effect, data)
    if first:
        best = with_latencies(best, data)
    return better_simulating(refined(best, data), data)


def fit_base(data: PlanarData, *, with_current: bool = False) -> PlanarOptimum:
    """The likeliest model without effects of thinned readings, from several starts; `refined` takes all readings.

    Where an effect is missing, the likelihood of this model says little: only the extended one decides by which
    criterion it is judged, see `better_simulating`.
    ``with_current``: a current is added next, so a coarse fit will do.
    """
    require_measured(data)
    starts, yaw_only = start_values(data, with_current=False), is_yaw_alone(data)
    # Wide smoothing leaves the least of the forces, but may leave no inertia: the sizes come from a start that
    # simulates the runs nearly as well as any.
    scores = [mean_free_run_r2(start.model, data, yaw_only=yaw_only) for start in starts]
    # One with the mass of the rigid body has to explain something: the thrust curve may be off.
    kept = [at for at, (one, score) in enumerate(zip(starts, scores, strict=True)) if score > 0.0 or not one.is_heavy]
    best_score = max(scores[at] for at in kept)
    usable = [at for at in kept if scores[at] >= best_score - _WORSE_START]
    in_current, simulating_best = start_values(data, with_current=True), max(usable, key=lambda at: scores[at])
    # Noise of the accelerations leaves nearly no inertia, and no force to compare with: then the mass tells the sizes.
    least = min(usable, key=lambda at: in_current[at].residual)
    sizes = planar_sizes(data, in_current[simulating_best if starts[simulating_best].is_heavy else least])
    sensors = tuple(name for name in data.sensors if not yaw_only or name in {"heading", "yaw_rate"})
    grid = planar_grid(data, sizes, yaw_only=yaw_only, interval=_SEARCH_SHARE * float(sizes.time.min()))
    # A slipstream that one start leaves out is free in all.
    usual = max((start.model for start in starts), key=lambda model: sum(one.slipstream for one in model.rudders))
    coordinates = PlanarCoordinates.of(usual, sizes, sensors, yaw_only=yaw_only)
    likelihood = PlanarLikelihood(grid, coordinates)
    points = [coordinates.projected(coordinates.initial(start.model, ())) for start in starts]
    # The likelihood of a start says little where the model is badly wrong: the best regression and the start that
    # simulates best are always followed.
    regressed = min(usable, key=lambda at: starts[at].residual)
    likely = min(kept, key=lambda at: likelihood.value(points[at]))
    hidden = has_hidden_sway(data) and not yaw_only
    followed = [points[at] for at in dict.fromkeys([likely] if hidden else [likely, regressed])]
    runs = None if yaw_only else FreeRuns.of(data, sizes)
    if runs is not None:
        simulating = replace(likelihood, free_runs=runs)
        best_first = sorted(usable, key=lambda at: -scores[at])[: _HIDDEN_STARTS if hidden else 1]
        followed += [PlanarOptimum.fit(simulating, points[at], _START_ITERATIONS).x for at in best_first]
    if data.prior is not None:
        followed.append(points[-1])
    # Without readings of the sway, a few steps do not tell which valley is deepest.
    steps = _HIDDEN_ITERATIONS if hidden else _FIRST_ITERATIONS
    tried = [PlanarOptimum.fit(likelihood, one, steps) for one in followed]
    best = min(tried, key=lambda one: one.value)
    _require_finite(best)
    if hidden:
        # The sway of the model that was found gives the limits of the disturbance and the units of the parameters.
        best = with_own_sizes(best, data)
    if with_current:
        return best
    # The start by the prior has the other parameters of a regression: it takes more steps, so it is always completed.
    ends = dict.fromkeys([best, tried[-1]] if data.prior is not None else [best])
    complete = (PlanarOptimum.fit(one.likelihood, one.x) for one in ends)
    return with_latencies(min(complete, key=lambda one: one.value), data)


def _require_finite(best: PlanarOptimum) -> None:
    """Refuse a fit whose filter diverged: its parameters mean nothing."""
    if not all(np.isfinite(one).all() for one in best.likelihood.evaluate(best.x)):
        raise DataError(
            "the fit diverged: no start of surge, sway and yaw follows the readings of these logs.",
            mend="Check the units and signs of [signals] and the thrust curves, or fit one axis with --axis yaw.",
        )


def with_latencies(best: PlanarOptimum, data: PlanarData) -> PlanarOptimum:
    """The fit with the stamps of late sensors moved back, until their latency beyond that is small.

    The filter takes a latency to first order. So the stamps are moved by the estimate, and the rest is estimated anew.
    A latency beyond `_MOST_LATENCY` by two standard errors stands for what the model misses: the fit then stays as it
    is, without latencies.
    """
    first = best
    for _ in range(_LATENCY_ROUNDS):
        coordinates, grid = best.coordinates, best.likelihood.grid
        more = coordinates.latencies(best.x)
        beyond = np.abs(grid.latency + more) - most_latencies(coordinates.sizes.time)
        if np.any(beyond > 0.0) and np.any(beyond > 2.0 * _latency_errors(best)):
            on_time = first.coordinates.on_time([True] * len(coordinates.instruments))
            x = first.x.copy()
            x[coordinates.latency_begin :] = 0.0
            return PlanarOptimum.fit(first.likelihood.with_coordinates(on_time), x)
        if np.abs(more).max() <= _LATENCY_TOLERANCE * float(coordinates.sizes.time.min()):
            break
        moved = planar_grid(
            data, coordinates.sizes, yaw_only=grid.yaw_only, interval=grid.interval, latency=grid.latency + more
        )
        x = best.x.copy()
        x[coordinates.latency_begin :] = 0.0
        best = PlanarOptimum.fit(PlanarLikelihood(moved, coordinates), x)
    return best


def most_latencies(time: FloatArray) -> FloatArray:
    """(6,) largest latency in s of each sensor; ``time`` are the (3,) time constants of the axes in s."""
    times = [time[2] if name in {"heading", "yaw_rate"} else min(time[:2]) for name in SENSORS]
    return np.asarray(np.minimum(_MOST_LATENCY * np.array(times), _MOST_SECONDS))


def _latency_errors(best: PlanarOptimum) -> FloatArray:
    """(6,) standard errors in s of the latency of each sensor; zero where it has none."""
    coordinates, found = best.coordinates, np.zeros(len(SENSORS))
    begin = coordinates.latency_begin
    errors = np.sqrt(np.diag(best.coordinate_covariance)[begin:]) * coordinates.units[begin:]
    for names, error in zip(coordinates.instruments, errors.tolist(), strict=True):
        found[list(map(SENSORS.index, names))] = error
    return found


def refined(best: PlanarOptimum, data: PlanarData) -> PlanarOptimum:
    """The fit to all readings, from a fit to thinned ones; a fit of free runs, which have all readings, as it is."""
    if best.is_multi_step:
        return best.canonical()
    coordinates, grid, x = best.coordinates, best.likelihood.grid, best.x.copy()
    latency = grid.latency + coordinates.latencies(x)
    x[coordinates.latency_begin :] = 0.0
    full = planar_grid(data, coordinates.sizes, yaw_only=grid.yaw_only, interval=0.0, latency=latency)
    return PlanarOptimum.fit(PlanarLikelihood(full, coordinates), x, _LAST_ITERATIONS).canonical()


def planar_result(data: PlanarData, best: PlanarOptimum) -> PlanarFit:
    """The fitted model with standard errors and with what the data cannot determine."""
    _require_finite(best)
    best = best.canonical()
    model, coordinates = best.model, best.coordinates
    covariance = best.covariance if best.is_multi_step else total_covariance(best)
    limited = tuple(np.array(AXIS_NAMES)[best.limited].tolist())
    if best.likeliest is not None:
        # Two criteria that disagree: each has an unknown error of the model.
        shift = best.likeliest - model.values
        turns = np.array([name.endswith(".direction") for name in model.names])
        shift = np.where(turns, np.remainder(shift + np.pi, 2.0 * np.pi) - np.pi, shift)
        covariance = covariance + np.outer(shift, shift)
    if best.likelihood.grid.yaw_only and is_pushed(data):
        covariance = covariance + yaw_alone_covariance(data, best)
    free = coordinates.free[: coordinates.noise_begin]
    names, scale = model.names, parameter_scale(best)
    r2 = free_run_r2(model, data, yaw_only=best.likelihood.grid.yaw_only)
    misfit = np.diag(misfit_variance(best, {} if best.likelihood.grid.yaw_only else r2, scale))
    is_ship = SHIP in {effect.key for effect in best.effects}
    covariance = (with_shape_error(model, covariance) if is_ship else covariance) + misfit
    undetermined, unknown = undetermined_directions(names, covariance, scale, free)
    refused = dict.fromkeys(unknown, "these runs do not determine it apart from other parameters")
    axes = measured_axes(data.sensors)
    for at, name in enumerate(names):
        if not free[at]:
            refused[name] = _reason(name, axes, is_ship=is_ship)
    refused |= dict(_lighter_than_rigid(data.vehicle.mass, model, np.sqrt(np.diag(covariance)), refused))
    covariance = with_rigid_body(covariance, model.values, data.vehicle.mass)
    # A contradiction to the prior may be what the model misses: it does not widen the errors that show it.
    prior = PriorUse.of(best, covariance - misfit, scale, refused)
    latency = _shown_latency(best)
    estimate = Estimate(
        names=names,
        values=model.values,
        covariance=np.where(np.isfinite(covariance), covariance, 0.0),
        method=_METHOD_FREE_RUNS if best.is_multi_step else _METHOD,
        samples=int(best.likelihood.grid.used.sum()),
        refused=refused,
        warnings=(*prior.contradictions, *_warnings(data, best, latency, limited, r2, refused)),
        from_prior=prior.decided,
    )
    estimate = replace(estimate, warnings=(*place_entries(estimate, best.effects), *estimate.warnings))
    estimate = estimate.with_assumptions(data.vehicle.assumptions, data.vehicle.relative_scale_error)
    numbers = coordinates.noise(best.x)
    disturbance = {
        name: (float(numbers[at]), float(numbers[NOISE_TIME + at]))
        for at, name in enumerate(AXIS_NAMES)
        if at == 2 or not best.likelihood.grid.yaw_only
    }
    return PlanarFit(
        model=model,
        estimate=estimate,
        log_likelihood=-best.likelihood.value_of(replace(best.likelihood, free_runs=None).filtered(best.x)[0]),
        undetermined=undetermined,
        noise={name: float(numbers[NOISE_SENSOR + SENSORS.index(name)]) for name in coordinates.sensors},
        disturbance=disturbance,
        at_limit=limited,
        latency=latency,
        white=best.is_white,
        multi_step=best.is_multi_step,
        free_run_r2=r2,
        prior=prior,
    )


def _shown_latency(best: PlanarOptimum) -> dict[str, tuple[float, float]]:
    """Sensor -> latency in s and standard error, where it shows; none of free runs, which have none."""
    if best.is_multi_step:
        return {}
    coordinates, found = best.coordinates, dict[str, tuple[float, float]]()
    errors, total = _latency_errors(best), best.likelihood.grid.latency + coordinates.latencies(best.x)
    for one in [SENSORS.index(name) for names in coordinates.instruments for name in names]:
        if abs(total[one]) > _LATENCY_SIGMAS * errors[one] > 0.0:
            found[SENSORS[one]] = float(total[one]), float(errors[one])
    return found


def _reason(name: str, axes: tuple[bool, bool, bool], *, is_ship: bool) -> str:
    if name == f"{SHIP}.length":
        return "it is held at twice the lever of the rudder"
    if is_ship and name.endswith("_drag"):
        return "it is left out: a ship's hull has damping in proportion to its speed, and forces of third order"
    if name.startswith("rudder"):
        return "the rudder is free, without a propeller ahead of it"
    for one, known in zip(AXIS_NAMES, axes, strict=True):
        if one in name.partition(".")[0] and not known:
            return f"neither a {one} velocity nor a position is measured"
    return "no actuator pushes the vehicle ahead or sideways in these runs"


def _warnings(
    data: PlanarData,
    best: PlanarOptimum,
    latency: Mapping[str, tuple[float, float]],
    limited: Sequence[str],
    r2: Mapping[str, float],
    refused: Mapping[str, str],
) -> Iterator[str]:
    for name, (late, _) in latency.items():
        way, moved = ("late", "back") if late > 0.0 else ("early", "forward")
        yield f"The readings of {name} are {significant(abs(late), 2)} s {way}; the fit moves them {moved}."
    if best.likelihood.grid.yaw_only:
        yield _DRIFTS if is_pushed(data) else _TURNS_ALONE
    if SHIP in {effect.key for effect in best.effects}:
        yield SHIP_WARNING
    looser = f" The standard errors include the change of the parameters under a limit {LOOSER:g} times as high."
    own = slice(best.coordinates.noise_begin, best.coordinates.noise_begin + len(AXIS_NAMES))
    limits = dict(zip(AXIS_NAMES, np.exp(best.coordinates.high[own]) / best.coordinates.sizes.force, strict=True))
    for name in limited:
        yield (
            f"The disturbance in {name} would exceed its limit of {100 * limits[name]:.3g} % of the forces in "
            f"use: the model misses an effect that these data show.{'' if best.is_multi_step else looser}"
        )
    if best.is_multi_step:
        yield (
            "The model misses too much for the likelihood of its innovations: the parameters are those of the best "
            "free-running simulation"
            + ("." if best.likeliest is None else ", and their errors include the difference from the likeliest ones.")
        )
    if not best.is_white:
        yield (
            "The innovations are not white. The standard errors come from the scatter between blocks of the logs, not "
            "from the curvature of the likelihood."
        )
    poor = [name for name, value in r2.items() if value < INNOVATIONS_R2]
    if poor and (limited or not best.is_white):
        shares = ", ".join(f"{name} {r2[name]:.2f}" for name in poor)
        yield f"R^2 of the free-running simulation is low: {shares}. The model misses something in these runs."
    least = _lighter_than_rigid(data.vehicle.mass, best.model, np.zeros(len(best.model.names)), refused)
    yield from (f"{name} may be too small: {why}. Its error includes the difference." for name, why in least)


def _lighter_than_rigid(
    mass: float | None, model: PlanarModel, errors: FloatArray, refused: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    """Inertias below the vehicle's ``mass`` by two (q,) ``errors``, and what that means."""
    for at, name in enumerate(("surge.inertia", "sway.inertia")):
        value = float(model.base[at])
        if mass is not None and name not in refused and value + 2.0 * errors[at] < _LEAST_RIGID * mass:
            both = f"{significant(value, 3)} kg, less than the vehicle's mass of {significant(mass, 3)} kg"
            yield name, f"it comes out as {both}: {_TOO_LIGHT}"
