"""Closed-loop simulation of a sampled controller and a plant with all of its effects, and metrics of the runs."""

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rovid.control.actuators import Allocation, bare_inputs
from rovid.control.control_law import ControlLaw
from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.effects.actuator_inputs import SPEEDS, ActuatorInputs, TrialRows, neutral_commands
from rovid.effects.base import TERM_STATES
from rovid.jit.simd import LANES
from rovid.model.actuator_model import CommandSeries
from rovid.model.model import Model
from rovid.model.torque_input import Intervals, TorqueInput
from rovid.trial.numba_loops import first_order_sum
from rovid.trial.vehicle import Vehicle

# s, longest step of the plant: torques enter as means over a step.
_LONGEST_STEP = 0.1
# s, windows of past commands for the actuators' effects; the whole run if neither suffices.
_WINDOWS = (20.0, 60.0)
# Influence of older commands that is neglected, relative to the largest torque, and to the largest of each other input.
_NEGLIGIBLE = 1e-4


@dataclass(frozen=True, kw_only=True)
class Plant:
    """The vehicle in the loop."""

    model: Model
    vehicle: Vehicle
    delay: float = 0.0  #: s, from a heading to the command that it leads to.
    heading_noise: float = 0.0  #: rad, standard deviation of white noise at each of the controller's samples.
    #: ``disturbance``, ``correlation_time``: N m and s, standard deviation and correlation time of a coloured torque.
    disturbance: float = 0.0
    correlation_time: float = 4.0

    def noise_free(self) -> Self:
        """The plant without noise and disturbance."""
        return replace(self, heading_noise=0.0, disturbance=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoop:
    """A ``plant`` under a ``law``, initially at rest."""

    law: ControlLaw
    allocation: Allocation
    plant: Plant
    setpoint: FloatArray  #: (m,) heading in rad at each of the controller's samples.
    initial_heading: float  #: rad.
    external_torque: FloatArray | None = None  #: (m,) in N m.
    seed: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoopRun:
    """Result of a simulation; all series are at the (n,) steps of the plant."""

    time: FloatArray
    #: ``heading``, ``rate``: as the sensor shows it without noise, in rad; true, in rad/s.
    heading: FloatArray
    rate: FloatArray
    #: ``setpoint``, ``torque``, ``external_torque``: rad; commanded torque in N m; N m.
    setpoint: FloatArray
    torque: FloatArray
    commands: FloatArray  #: (n, k), held.
    external_torque: FloatArray
    drive: TorqueInput  #: Torque of the commands, and the other inputs of the effects.


def simulate_loops(loops: Sequence[ClosedLoop]) -> list[ClosedLoopRun]:
    """Simulate ``loops`` with one model, vehicle, sampling period and length together.

    The effects between command and torque are evaluated on a trailing window of commands. If the result differs from
    that on all commands, the window is extended, at most to the whole run.
    """
    law, plant = loops[0].law, loops[0].plant
    steps = _steps_per_period(law.period)
    time = law.period / steps * np.arange(len(loops[0].setpoint) * steps + 1, dtype=np.float64)
    actuators = plant.model.actuators
    # One step more than the run: before it the thrusters are idle.
    where = bare_inputs(plant.vehicle, np.append(time, time[-1] + time[1]), actuators.subdivision)
    idle = neutral_commands(plant.vehicle)
    windows = [round(length / law.period * steps) for length in _WINDOWS]
    for window in (*windows, len(time)):
        runs = _simulate(loops, time, where, window)
        if window >= len(time) or actuators.is_plain:
            break
        rows = [np.vstack((idle, run.commands)) for run in runs]
        wholes = [actuators.torque_inputs(CommandSeries(plant.vehicle, where, commands)) for commands in rows]
        if all(_is_equal(whole, run.drive) for whole, run in zip(wholes, runs, strict=True)):
            break
    return runs


def _steps_per_period(period: float) -> int:
    return max(math.ceil(period / _LONGEST_STEP - 1e-9), 1)


def _is_equal(whole: TorqueInput, windowed: TorqueInput) -> bool:
    """Whether commands before the window have no influence on the torque and on the other inputs of the effects.

    ``whole`` has the idle step before the run as its first row.
    """
    expected = np.column_stack((whole.torque, whole.effect_inputs))[1:]
    found = np.column_stack((windowed.torque, windowed.effect_inputs))
    tolerance = _NEGLIGIBLE * np.maximum(np.max(np.abs(expected), axis=0), 1e-9)
    return bool(np.all(np.abs(expected - found)[:-1] <= tolerance))


def _simulate(loops: Sequence[ClosedLoop], time: FloatArray, where: ActuatorInputs, window: int) -> list[ClosedLoopRun]:
    """Alternate between controllers and plants, and the actuators, which are evaluated for all loops at once."""
    plant, count, n = loops[0].plant, len(loops), len(time)
    steps = _steps_per_period(loops[0].law.period)
    wanted, torque, moment = np.zeros((3, count, n))
    from_idle = np.tile(neutral_commands(plant.vehicle), (count, 1 + n, 1))
    commands = from_idle[:, 1:]
    effect_inputs = np.zeros((count, n, 1 + len(SPEEDS)))
    runs = []
    for at, loop in enumerate(loops):
        run = ClosedLoopRun(
            time=time,
            heading=np.full(n, loop.initial_heading),
            rate=np.zeros(n),
            setpoint=np.append(np.repeat(loop.setpoint, steps), loop.setpoint[-1]),
            torque=wanted[at],
            commands=commands[at],
            external_torque=_external_torque(loop, time),
            drive=TorqueInput(torque[at], moment[at], effect_inputs[at], np.zeros(n), np.array([0, n])),
        )
        runs.append(run)
    running = [_control(loop, run) for loop, run in zip(loops, runs, strict=True)]
    users = {loop.allocation: [other.allocation is loop.allocation for other in loops] for loop in loops}
    for at in range(0, n - 1, steps):
        for controlled in running:
            next(controlled)
        for allocation, rows in users.items():
            commands[rows, at : at + steps + 1] = allocation(wanted[rows, at])[:, None]
        latest = _latest_inputs(plant, where, from_idle[:, : at + steps + 2], max(at - window, 0), steps)
        for series, values in zip((torque, moment, effect_inputs), latest, strict=True):
            series[:, at : at + steps] = values
    for controlled in running:
        next(controlled, None)
    return runs


def _control(loop: ClosedLoop, run: ClosedLoopRun) -> Iterator[None]:
    """Fill in ``run`` one sample at a time: yield once the wanted torque is known, resume once its drive is known.

    The heading is the true one until the end of the run, and then that of the sensor.
    """
    from rovid.model.kernels import SCRATCH_ROWS, advance

    law, plant, heading, drive = loop.law, loop.plant, run.heading, run.drive
    model, steps, step = plant.model, _steps_per_period(law.period), float(run.time[1])
    noise = np.random.default_rng([loop.seed, 1]).normal(0.0, 1.0, len(loop.setpoint)) * plant.heading_noise
    equation, sensor = model.equation(loop.initial_heading), model.heading_sensor
    rows = TERM_STATES * len(equation.terms.kinds)
    states, scratch = np.zeros((rows, LANES)), np.zeros((3, rows + SCRATCH_ROWS, LANES))
    rate, angle, stiffness, state = 0.0, 0.0, 0.0, None
    for k, setpoint in enumerate(loop.setpoint.tolist()):
        at = k * steps
        measured = _interpolate(heading, at - plant.delay / step)
        if sensor.deviates:
            measured += float(sensor.deviation(np.array([measured]))[0])
        measured += noise[k]
        if not math.isfinite(measured):
            mend = "Check the parameter file: a time constant may be far too short for its effect. Fit again."
            raise DataError("the simulated closed loop diverges with these parameters.", mend=mend)
        state = law.initial_state(measured) if state is None else state
        run.torque[at : at + steps], state = law.step(state, measured, setpoint)
        yield
        for j in range(at, at + steps):
            inputs = drive.torque[j], run.external_torque[j], drive.timing_moment[j], drive.effect_inputs[j]
            rate, angle, stiffness = advance(rate, angle, *inputs, step, equation, states, scratch, stiffness)
            heading[j + 1], run.rate[j + 1] = loop.initial_heading + angle, rate
    for series in (run.torque, drive.torque, drive.effect_inputs):
        series[-1] = series[-2]
    if sensor.deviates:
        heading += sensor.deviation(heading)


def _latest_inputs(
    plant: Plant, where: ActuatorInputs, commands: FloatArray, first: int, steps: int
) -> tuple[FloatArray, FloatArray | float, FloatArray | float]:
    """(l, m) torque and moment, and (l, m, 3) other inputs, of (l, n, k) ``commands`` in the last m ``steps``.

    Scalars stand for constants. Commands before the step ``first`` are ignored.
    """
    actuators, vehicle, (count, last, k) = plant.model.actuators, plant.vehicle, commands.shape
    if actuators.is_plain:
        return (vehicle.thrust(commands[:, -1]) @ where.arms)[:, None], 0.0, 0.0
    length, parts = last - first, where.subdivision
    trials, intervals = _parallel_trials(float(where.time[parts]), parts, length - 1, count)
    time = np.tile(where.time[first * parts : (last - 1) * parts + 1], count)
    series = CommandSeries(vehicle, replace(where, time=time, trials=trials), commands[:, first:].reshape(-1, k))
    drive = actuators.torque_inputs(series, intervals)
    torque, moment = drive.torque.reshape(count, length), drive.timing_moment.reshape(count, length)
    latest = slice(-steps - 1, -1)
    return torque[:, latest], moment[:, latest], drive.effect_inputs.reshape(count, length, -1)[:, latest]


# Once the run is longer than the window, all steps have the same arguments.
@functools.lru_cache(maxsize=4)
def _parallel_trials(
    step: float, parts: int, length: int, count: int
) -> tuple[tuple[TrialRows, ...], Intervals | None]:
    """``count`` trials of ``length`` steps in s, each cut into ``parts``, with their intervals if there are parts."""
    at = parts * np.arange(length + 1)
    ends = range(at[-1] + 1, count * (at[-1] + 1) + 1, at[-1] + 1)
    trials = tuple(TrialRows(rows=slice(end - at[-1] - 1, end)) for end in ends)
    if parts == 1:
        return trials, None
    return trials, Intervals.from_times([step / parts * np.arange(at[-1] + 1)] * count, [at] * count)


def _interpolate(values: FloatArray, place: float) -> float:
    """Linear interpolation of ``values`` at whole places; the first value before them."""
    whole = int(max(place, 0.0))
    share = max(place, 0.0) - whole
    if share == 0.0:
        return float(values[whole])
    return float(values[whole] + share * (values[whole + 1] - values[whole]))


def _external_torque(loop: ClosedLoop, time: FloatArray) -> FloatArray:
    """(n,) external torque in N m with the coloured disturbance and, unless noise-free, the model's waves."""
    plant, rng = loop.plant, np.random.default_rng([loop.seed, 0])
    total = np.zeros(len(time))
    if loop.external_torque is not None:
        steps = _steps_per_period(loop.law.period)
        total += np.append(np.repeat(loop.external_torque, steps), loop.external_torque[-1])
    if plant.disturbance > 0.0:
        total += _gauss_markov(time, plant.disturbance, plant.correlation_time, rng)
    wave = plant.model.wave_parameters
    if wave.size and (plant.disturbance > 0.0 or plant.heading_noise > 0.0):
        amplitude, frequency, damping = wave
        size, correlation_time = amplitude / math.sqrt(2.0), 1.0 / (damping * frequency)
        # Narrow-band noise: two slow amplitudes in quadrature.
        total += _gauss_markov(time, size, correlation_time, rng) * np.cos(frequency * time)
        total += _gauss_markov(time, size, correlation_time, rng) * np.sin(frequency * time)
    return total


def _gauss_markov(time: FloatArray, size: float, correlation_time: float, rng: np.random.Generator) -> FloatArray:
    """(n,) stationary first-order Gauss-Markov series with standard deviation ``size``."""
    fade = math.exp(-float(time[1] - time[0]) / correlation_time)
    increments = rng.normal(0.0, size * math.sqrt(1.0 - fade**2), len(time))
    increments[0] = rng.normal(0.0, size)
    return first_order_sum(increments, fade)


# Share of the step at one time constant of an exponential.
_RISEN = 1.0 - math.exp(-1.0)
# Settling band: share of the step, or deg, steady error of the paper, whichever is larger.
_SETTLED_SHARE, _SETTLED_DEG = 0.02, 0.6
# Final share of a run for the steady error and limit cycles.
_END = 1.0 / 3.0
# deg, smallest amplitude of a limit cycle; ratio of the amplitudes of both halves below which it decays.
_VISIBLE, _DECAYING = 0.01, 0.8


@dataclass(frozen=True, kw_only=True)
class LimitCycle:
    """Sustained oscillation without noise and disturbance."""

    amplitude_deg: float
    period_s: float


@dataclass(frozen=True, kw_only=True)
class StepMetrics:
    """Metrics of one run; None where there is no step, or it was not reached."""

    #: ``time_constant``, ``rise_time``, ``settling_time``: s; to 63 % of the step, from 10 to 90 %, and until the error
    #: stays within 2 % or 0.6 deg.
    time_constant: float | None = None
    rise_time: float | None = None
    settling_time: float | None = None
    #: ``overshoot_deg``, ``steady_error_deg``: deg; largest error over the last third of the run.
    overshoot_deg: float | None = None
    steady_error_deg: float
    #: ``effort``, ``effort_change``: N m, root mean square of the commanded torque, and of its change from step to
    #: step.
    effort: float
    effort_change: float
    limit_cycle: LimitCycle | None  #: In the same run without noise and disturbance.


def step_metrics(run: ClosedLoopRun, noise_free: ClosedLoopRun) -> StepMetrics:
    """Metrics of ``run``, with the limit cycle of the same run without noise and disturbance."""
    time, error = run.time, np.degrees(run.setpoint - run.heading)
    metrics = StepMetrics(
        steady_error_deg=float(np.max(np.abs(error[time >= (1.0 - _END) * time[-1]]))),
        effort=float(np.sqrt(np.mean(run.torque**2))),
        effort_change=float(np.sqrt(np.mean(np.diff(run.torque) ** 2))),
        limit_cycle=limit_cycle(noise_free.time, np.degrees(noise_free.heading)),
    )
    step = float(error[0])
    if not abs(step) > 2.0 * _SETTLED_DEG:
        return metrics
    response = 1.0 - error / step
    at10, at90 = _first_time(time, response, 0.1), _first_time(time, response, 0.9)
    outside = np.flatnonzero(np.abs(error) > max(_SETTLED_SHARE * abs(step), _SETTLED_DEG))
    settled = int(outside[-1]) + 1  # The first sample of a step is outside.
    return replace(
        metrics,
        time_constant=_first_time(time, response, _RISEN),
        rise_time=None if at10 is None or at90 is None else at90 - at10,
        settling_time=None if settled == len(time) else float(time[settled]),
        overshoot_deg=max(float(np.max(response) - 1.0) * abs(step), 0.0),
    )


def limit_cycle(time: FloatArray, heading: FloatArray) -> LimitCycle | None:
    """Oscillation over the last third of (n,) ``heading`` in deg at ``time`` in s; None if it decays."""
    late = time >= (1.0 - _END) * time[-1]
    t, swing = time[late], heading[late] - np.mean(heading[late])
    first, second = np.array_split(swing, 2)
    before, after = float(np.ptp(first)) / 2.0, float(np.ptp(second)) / 2.0
    rising = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    if after < _VISIBLE or after < _DECAYING * before or len(rising) < 2:
        return None
    return LimitCycle(amplitude_deg=after, period_s=float(np.mean(np.diff(t[rising]))))


def _first_time(time: FloatArray, response: FloatArray, share: float) -> float | None:
    """Time at which ``response`` first reaches ``share``, interpolated."""
    above = np.flatnonzero(response >= share)
    if not above.size:
        return None
    at = int(above[0])
    if at == 0:
        return 0.0
    pair = slice(at - 1, at + 1)
    return float(np.interp(share, response[pair], time[pair]))
