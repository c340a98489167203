"""What a planar fit needs before its first step: start values, typical sizes, and the arrays of the compiled loops.

Start values are those of a regression of inverse dynamics on smoothed speeds. docs/planar.md.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import DataError
from rovid.estimate.dataset import effect_scales
from rovid.planar import dataset
from rovid.planar.coordinates import PlanarCoordinates, PlanarSizes
from rovid.planar.equations import SURGE
from rovid.planar.likelihood import MAX_COUPLING, PlanarGrid, PlanarLikelihood
from rovid.planar.model import BASE_COUNT, INPUT_COUNT, RUDDER_INPUTS, PlanarModel, RudderModel
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.regression import regression, unit_rudder_forces

# Widths of the smoothing kernel in intervals of the slowest sensor.
_WIDTHS, _FEW_WIDTHS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0), (2.0, 4.0, 8.0)
# Stall angle of a rudder where rovid.toml gives none.
_STALL = math.radians(35.0)
# Currents of the search: speeds in shares of the RMS speed, and number of directions.
_CURRENT_SHARES, _CURRENT_DIRECTIONS = (0.15, 0.4, 0.8, 1.5), 8
# Places of sensors ahead or astern of the origin, in the usual radius of the turns.
_PLACES = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.28)
# Most smoothed points of a regression, and of one that compares hulls.
_MOST_POINTS, _FEW_POINTS = 3000, 600
# Radius of gyration of a hull with a rudder in the rudder's lever: usual, and least of a regression that is believed.
_GYRATION, _LEAST_GYRATION = 0.5, 0.15
# Least yaw inertia of a regression that is believed, in that of a mass at a tenth of the squared radius of the turns.
_LEAST_INERTIA = 1e-6
# Hulls that give a sway that is not measured: inertia over that of surge, and time constants over that of yaw.
# With a rudder the unit of time is that of the way of its lever, and its lift counts in the mass over the lever.
_SWAY_INERTIAS, _SWAY_TIMES, _LIFTS = (1.2, 2.0), (0.3, 1.0, 3.0, 10.0), (0.1, 0.3, 1.0)
# Noise of a sensor at the start where its readings do not show it, in shares of the typical speed or time constant.
_DEFAULT_NOISE = 0.02
# Standard deviation of the speeds at the start of a run, in typical speeds.
START_STD = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class StartValues:
    """A start of the fit."""

    model: PlanarModel
    current: tuple[float, float]  #: m/s to north and to east; zeros unless searched for.
    place: float  #: m ahead of the origin, of the sensors of the speeds; zero unless searched for.
    #: ``force``, ``speed``, ``time``: (3,) typical sizes: RMS of the forces, RMS of the speeds, and time constants.
    force: FloatArray
    speed: FloatArray
    time: FloatArray
    residual: float  #: Share of the variance of the forces that the regression leaves.
    is_heavy: bool = False  #: Whether the mass of the rigid body made the inertias larger.


def planar_rudders(data: dataset.PlanarData) -> tuple[RudderModel, ...]:
    """The rudders of the vehicle, with what rovid.toml gives of them."""
    found = []
    for name, rudder in zip(data.actuators.rudder_names, data.actuators.rudders, strict=True):
        stall = _STALL if rudder.stall is None else rudder.stall
        lift, slipstream = rudder.lift or 0.0, rudder.slipstream or 0.0
        known = RudderModel(name=name, position=rudder.position, stall=stall, lift=lift, slipstream=slipstream)
        found.append(replace(known, resistance=1.0))
    return tuple(found)


def start_values(
    data: dataset.PlanarData, *, with_current: bool, with_place: bool = False, known: tuple[float, float] = (0.0, 0.0)
) -> list[StartValues]:
    """Starts of the fit by several widths of the smoothing, and by the prior if there is one, which is the last.

    ``known``: m/s; current to north and east, unless one is searched for. Noise of the accelerations makes fitted
    inertias too small. Where the mass is known, each width has a second start.

    Raises
    ------
    DataError
        The runs are too short, or nothing moves.
    """
    axes, found = np.array(dataset.measured_axes(data.sensors)), []
    for runs in _smoothed(data, _WIDTHS):
        rows = dataset.SmoothRun.stacked(runs, _FEW_POINTS if with_place else _MOST_POINTS)
        start = _start(data, rows, axes, with_current=with_current, with_place=with_place, known=known)
        if dataset.has_hidden_sway(data):
            slips = np.array([rudder.slipstream for rudder in start.model.rudders])
            every, rudders = np.ones(3, dtype=bool), start.model.rudders
            rows = min(_with_sway(runs, start), key=lambda rows: regression(rows, every, rudders, slips)[0])
            start = _start(data, rows, every, with_current=False)
        found.append(start)
        if (mass := data.vehicle.mass) is not None and axes[:2].all():
            own = rows.from_place(start.place).in_current(*start.current)
            heavy = _start(data, own, axes, with_current=False, mass=mass)
            is_heavy = bool(start.model.base[:2].min() < mass)  # Else both starts are the same.
            found.append(replace(heavy, current=start.current, place=start.place, is_heavy=is_heavy))
    if not found:
        text = f"the runs are too short: {max(run.duration for run in data.runs):.1f} s at most."
        raise DataError(text, mend="Give longer logs, or readings at a higher rate.")
    if data.prior is not None:
        found.append(replace(found[0], model=data.prior.start(found[0].model)))
    return found


def _smoothed(data: dataset.PlanarData, widths: Sequence[float]) -> Iterator[list[dataset.SmoothRun]]:
    """The runs through kernels of these ``widths`` in intervals of the slowest sensor, while they are long enough."""
    usable = [run for run in data.runs if any(len(run.readings(name).time) > 2 for name in run.sensors)]
    if not usable:
        raise DataError("no run has three readings of one sensor.", mend="Give longer logs.")
    slowest = max(map(dataset.slowest_interval, usable))
    for width in widths:
        runs = [smooth for run in data.runs if (smooth := dataset.smooth_run(run, width * slowest)) is not None]
        if sum(len(run.time) for run in runs) < 4 * BASE_COUNT:
            return
        yield runs


def unexplained_share(data: dataset.PlanarData, *, with_current: bool) -> float:
    """Least share of the variance of the forces that a regression leaves; infinite for runs that are too short.

    Raises DataError if nothing moves.
    """
    axes = np.array(dataset.measured_axes(data.sensors))
    rows = (dataset.SmoothRun.stacked(runs, _FEW_POINTS) for runs in _smoothed(data, _FEW_WIDTHS))
    return min((_start(data, one, axes, with_current=with_current).residual for one in rows), default=math.inf)


def _with_sway(runs: Sequence[dataset.SmoothRun], start: StartValues) -> Iterator[dataset.SmoothRun]:
    """The ``runs``, thinned, with the sway of each of some hulls, where the logs measure surge and yaw alone.

    The centripetal force of a turn and the actuators drive the sway: m_v (v' + v/T) = Y - m_u u r. With the true m_v
    and T, the Munk moment of this sway explains the most of the yaw. The lift of a rudder is another unknown.
    """
    from scipy.signal import lfilter  # The import takes long.

    mass, rudders = float(start.model.base[0]), start.model.rudders
    lever = max((abs(rudder.position[0]) for rudder in rudders), default=0.0)
    unit = lever / float(start.speed[0]) if lever else float(start.time[2])
    lifts = [share * mass / lever for share in _LIFTS] if lever else [0.0]
    for ratio, share, lift in product(_SWAY_INERTIAS, _SWAY_TIMES, lifts):
        constant, guess = share * unit, []
        for run in runs:
            side = run.inputs[:, 1] - mass * run.speeds[:, 0] * run.speeds[:, 2]
            for at, rudder in enumerate(rudders):
                side = side + lift * unit_rudder_forces(rudder, rudder.slipstream, run, at)[:, 1]
            push = side / (ratio * mass)
            decay = math.exp(-float(run.time[1] - run.time[0]) / constant)
            sway = lfilter([0.0, constant * (1.0 - decay)], [1.0, -decay], push)
            speeds, accelerations = run.speeds.copy(), run.accelerations.copy()
            speeds[:, 1], accelerations[:, 1] = sway, push - sway / constant
            guess.append(replace(run, speeds=speeds, accelerations=accelerations))
        yield dataset.SmoothRun.stacked(guess, _FEW_POINTS)


def _start(
    data: dataset.PlanarData,
    rows: dataset.SmoothRun,
    axes: BoolArray,
    *,
    with_current: bool,
    with_place: bool = False,
    known: tuple[float, float] = (0.0, 0.0),
    mass: float = 0.0,
) -> StartValues:
    rudders = planar_rudders(data)
    speed = np.sqrt(np.mean(rows.speeds**2, axis=0))
    if not speed[2] > 0.0 and not speed[:2].any():
        raise DataError("the vehicle does not move in these logs.", mend="Give logs of runs with commands.")
    best, values, slipstreams, current, place = math.inf, np.zeros(0), np.zeros(len(rudders)), known, 0.0
    places, currents = [0.0], [known]
    if with_place and speed[2] > 0.0:
        radius = math.hypot(speed[0], speed[1]) / float(speed[2])
        places += [side * share * radius for share in _PLACES for side in (1.0, -1.0)]
    if with_current and axes[:2].all():
        size = math.hypot(speed[0], speed[1])
        angles = np.arange(_CURRENT_DIRECTIONS) * 2.0 * math.pi / _CURRENT_DIRECTIONS
        currents += [(size * s * math.cos(a), size * s * math.sin(a)) for s in _CURRENT_SHARES for a in angles]
    for ahead, here, slips in product(places, currents, _slipstreams(rudders, rows)):
        residual, fitted = regression(rows.from_place(ahead).in_current(*here), axes, rudders, slips, mass)
        if residual < best:
            best, values, slipstreams, current, place = residual, fitted, slips, here, ahead
    relative = rows.from_place(place).in_current(*current)
    lever = max((abs(rudder.position[0]) for rudder in rudders), default=0.0)
    base, force, time = _plausible(values[:BASE_COUNT], relative, axes, lever)
    speed = np.sqrt(np.mean(relative.speeds**2, axis=0))
    speed = np.where(speed > 0.0, speed, max(speed.max(), 1e-6))
    found = [
        replace(rudder, lift=float(max(lift, 0.0)) or rudder.lift, slipstream=float(slip))
        for rudder, lift, slip in zip(rudders, values[BASE_COUNT:], slipstreams, strict=True)
    ]
    model = PlanarModel(base=base, rudders=tuple(found))
    return StartValues(model=model, current=current, place=place, force=force, speed=speed, time=time, residual=best)


def with_rudders_of(model: PlanarModel, start: PlanarModel) -> PlanarModel:
    """The ``start`` with the parameters that the rudders of ``model`` have, and with its own lifts and slipstreams."""
    pairs = zip(model.rudders, start.rudders, strict=True)
    return replace(start, rudders=tuple(replace(one, lift=own.lift, slipstream=own.slipstream) for one, own in pairs))


def with_own_sizes(best: PlanarOptimum, data: dataset.PlanarData) -> PlanarOptimum:
    """The same model without effects, with the sizes of the sway that its filter estimates: the logs have none."""
    model, old, grid, runs = best.model, best.coordinates, best.likelihood.grid, []
    _, states = best.likelihood.filtered(best.x, keep=True)
    parts = (np.split(one, grid.offsets[1:-1]) for one in (grid.time, states[:, SURGE + 1]))
    for run, time, sway in zip(data.runs, *parts, strict=True):
        if (rows := dataset.smooth_motion(run)) is None:
            continue
        rows.speeds[:, 1] = np.interp(rows.time, time, sway)
        rows.accelerations[:, 1] = np.gradient(rows.speeds[:, 1], rows.time)
        for at, rudder in enumerate(model.rudders):
            rows.inputs[:, :INPUT_COUNT] += rudder.lift * unit_rudder_forces(rudder, rudder.slipstream, rows, at)
        runs.append(rows)
    rows = dataset.SmoothRun.stacked(runs, _MOST_POINTS)
    _, force, time = _plausible(model.base, rows, np.ones(3, dtype=bool), 0.0)
    speed = np.sqrt(np.mean(rows.speeds**2, axis=0))
    start = StartValues(model=model, current=(0.0, 0.0), place=0.0, force=force, speed=speed, time=time, residual=0.0)
    sizes = planar_sizes(data, start)
    coordinates = PlanarCoordinates.of(model, sizes, old.sensors, yaw_only=False)
    x = np.concatenate((coordinates.initial(model, ())[: old.noise_begin], best.x[old.noise_begin :]))
    grid = planar_grid(data, sizes, yaw_only=False, interval=grid.interval, latency=grid.latency)
    return PlanarOptimum.fit(PlanarLikelihood(grid, coordinates), x)


def _slipstreams(rudders: tuple[RudderModel, ...], rows: dataset.SmoothRun) -> list[FloatArray]:
    """Slipstream factors to try: the given ones, or those that add a share of the squared speed."""
    thrust, given = rows.inputs[:, INPUT_COUNT + 1 :: RUDDER_INPUTS], np.array([one.slipstream for one in rudders])
    if not rudders or not thrust.any():
        return [given]
    squared = float(np.mean(rows.speeds[:, 0] ** 2))
    usual = np.sqrt(np.mean(thrust**2, axis=0))
    free = np.where(usual > 0.0, squared / np.maximum(usual, 1e-300), 0.0)
    return [np.where(given > 0.0, given, share * free) for share in (0.0, 0.5, 1.5)]


def _plausible(
    base: FloatArray, rows: dataset.SmoothRun, axes: BoolArray, lever: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Base parameters with positive inertia, (3,) RMS forces and (3,) time constants; ``lever`` of the rudders in m."""
    base = base.copy()
    speed = np.sqrt(np.mean(rows.speeds**2, axis=0))
    change = np.sqrt(np.mean(rows.accelerations**2, axis=0))
    forces = np.sqrt(np.mean(rows.inputs[:, :INPUT_COUNT] ** 2, axis=0))
    for axis in range(3):
        least = 0.05 * forces[axis] / max(change[axis], 1e-300) if change[axis] > 0.0 else 0.0
        base[axis] = max(base[axis], least)
    # An inertia without any information takes that of another axis.
    known = base[:2].max()
    base[:2] = np.where(base[:2] > 1e-6 * known, base[:2], known if known > 0.0 else 1.0)
    # A hull that is steered by a rudder at its end: a radius of gyration of half the rudder's lever.
    if base[2] < _LEAST_GYRATION**2 * base[0] * lever**2:
        base[2] = _GYRATION**2 * base[0] * lever**2
    # Where nothing turns the hull, its sway alone gives a yaw inertia of nearly zero.
    usual_inertia = max(base[:2].max() * (speed[:2].max() / max(speed[2], 1e-9)) ** 2 * 0.1, 1e-9)
    if not base[2] > _LEAST_INERTIA * usual_inertia:
        base[2] = usual_inertia
    most = MAX_COUPLING * math.sqrt(base[1] * base[2])
    base[3] = min(max(base[3], -most), most) if axes[1] else 0.0
    u, v, r = rows.speeds.T
    across = base[1] * v + base[3] * r
    inertial = np.column_stack((across * r, base[0] * u * r, across * u - base[0] * u * v))
    inertial += rows.accelerations * base[:3]
    force = np.sqrt(np.mean(inertial**2, axis=0) + forces**2)
    force = np.where(force > 0.0, force, max(force.max(), 1e-9))
    usual = np.where(speed > 0.0, speed, 1.0)
    damping = base[4:7] + 2.0 * base[7:10] * usual
    time = base[:3] / np.maximum(damping, 1e-2 * base[:3] * change / usual + 1e-300)
    return base, force, np.clip(time, 1e-3, 1e6)


def first_noise(data: dataset.PlanarData, name: str) -> float:
    """Median standard deviation of the noise of a sensor over all runs; NaN where it has too few readings."""
    values = [dataset.sensor_noise(run, name) for run in data.runs if name in run.sensors]
    finite = [value for value in values if math.isfinite(value)]
    return float(np.median(finite)) if finite else math.nan


def planar_sizes(data: dataset.PlanarData, start: StartValues) -> PlanarSizes:
    """Typical sizes of the runs, by the regression that gave ``start``."""
    longest = max(run.duration for run in data.runs)
    shortest = min(float(np.median(np.diff(run.time))) for run in data.runs)
    time = np.clip(start.time, shortest, max(longest, 2.0 * shortest))
    noise = {}
    for name in data.sensors:
        found = first_noise(data, name)
        axis = {"surge_velocity": 0, "sway_velocity": 1, "north": 0, "east": 0}.get(name, 2)
        usual = start.speed[axis] * (1.0 if name.endswith(("velocity", "rate")) else time[axis])
        noise[name] = found if found > 1e-6 * usual else _DEFAULT_NOISE * usual
    columns = data.actuators.thruster_columns
    trials = [replace(run.trial, commands=run.trial.commands[:, columns], past=None) for run in data.runs]
    force, speed, thrusters = start.force.tolist(), start.speed.tolist(), data.actuators.thrusters
    scales = effect_scales(trials, thrusters if len(columns) else None, force[2], speed[2], float(time[2]))
    if data.actuators.steered:  # Effects on commands act on the angles.
        angles = [run.trial.commands[:, data.actuators.angle_columns] for run in data.runs]
        scales = replace(scales, command=max(float(np.max(np.abs(angle))) for angle in angles) or scales.command)
    return PlanarSizes(
        force=start.force,
        speed=start.speed,
        time=time,
        inertia=(start.model if data.prior is None else data.prior.start(start.model)).base[:3],
        effects=replace(scales, surge=speed[0], sway=speed[1], surge_force=force[0], sway_force=force[1]),
        noise=noise,
    )


def planar_grid(
    data: dataset.PlanarData, sizes: PlanarSizes, *, yaw_only: bool, interval: float, latency: FloatArray | None = None
) -> PlanarGrid:
    """The runs as arrays of the compiled loops, with the smoothed speeds at the start of each."""
    starts = np.zeros((len(data.runs), 6))
    stds = np.zeros((len(data.runs), 6))
    stds[:, 1:4] = START_STD * sizes.speed
    for number, run in enumerate(data.runs):
        smooth = dataset.smooth_run(run, max(0.3 * float(sizes.time.min()), 3.0 * float(np.median(np.diff(run.time)))))
        if smooth is not None:
            starts[number, 1:4] = smooth.speeds[0]
        for at, name, rate in ((0, "heading", 3), (4, "north", 1), (5, "east", 1)):
            if name in run.sensors:
                first = run.readings(name)
                starts[number, at] = first.values[0]
                # Without a reading at the start the position there is uncertain by what the vehicle moves until then.
                stds[number, at] = sizes.speed[rate - 1] * float(first.time[0])
    return PlanarGrid.of(data, starts, stds, sizes.speed, yaw_only=yaw_only, interval=interval, latency=latency)
