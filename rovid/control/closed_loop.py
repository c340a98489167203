"""The closed loop: a controller sampled at its period, a plant integrated between the samples with all its effects."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rovid.control.allocation import Allocation, bare_actuation
from rovid.control.control_law import ControlLaw
from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import SPEEDS, ActuatorInputs, TrialRows
from rovid.effects.base import TERM_STATES
from rovid.jit.simd import LANES
from rovid.model.command_series import CommandSeries
from rovid.model.model import Model
from rovid.model.torque_input import Intervals, TorqueInput
from rovid.signals.numba_loops import first_order_sum
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# s; no tick of the plant is longer, lest the mean of a torque that acts late in it be all that is known of it.
_LONGEST_TICK = 0.1
# s of commands that are looked back upon at each step; where neither is enough, all of them are.
_WINDOWS = (20.0, 60.0)
# Of the largest torque, and of the largest speed of each kind: what an effect remembers from before the window.
_FORGOTTEN = 1e-4


@dataclass(frozen=True, kw_only=True)
class Plant:
    """The vehicle as the controller meets it.

    Attributes
    ----------
    model
        With the effects that act.
    delay
        s, from a heading to the command that it leads to.
    heading_noise
        rad, standard deviation, white, at each of the controller's samples.
    disturbance, memory
        N m, standard deviation, and s, correlation time, of a coloured torque.
    """

    model: Model
    vehicle: Vehicle
    delay: float = 0.0
    heading_noise: float = 0.0
    disturbance: float = 0.0
    correlation_time: float = 4.0

    def noise_free(self) -> Plant:
        """The same without noise and disturbance."""
        return replace(self, heading_noise=0.0, disturbance=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoopRun:
    """One closed-loop run.

    Attributes
    ----------
    time
        (n,) s, ticks of the plant.
    heading, rate
        (n,) as the instrument would show it without its noise, in rad; true, in rad/s.
    wanted, torque
        (n,) rad; (n,) N m that the controller asks for, held.
    commands
        (n, k), held.
    outside
        (n,) N m from outside, held.
    drive
        What the commands made, tick by tick.
    """

    time: FloatArray
    heading: FloatArray
    rate: FloatArray
    setpoint: FloatArray
    torque: FloatArray
    commands: FloatArray
    external_torque: FloatArray
    drive: TorqueInput

    def trial(self) -> Trial:
        """As a log would hold it."""
        return Trial(name="closed loop", path=Path(), time=self.time, position=self.heading, commands=self.commands)


def ticks_per_period(period: float) -> int:
    """Ticks of the plant in each of the controller's periods."""
    return max(math.ceil(period / _LONGEST_TICK - 1e-9), 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoop:
    """A ``plant`` under a ``law``, at rest at ``start`` in rad.

    Attributes
    ----------
    wanted
        (m,) heading in rad at each of the controller's samples.
    outside
        (m,) further torque from outside in N m.
    """

    law: ControlLaw
    allocation: Allocation
    plant: Plant
    setpoint: FloatArray
    initial_heading: float
    external_torque: FloatArray | None = None
    seed: int = 0


def simulate_loops(loops: Sequence[ClosedLoop]) -> list[ClosedLoopRun]:
    """Run ``loops`` of one model and vehicle, sampled alike and equally long, side by side.

    The effects between command and torque are those of the catalogue, on the commands of a trailing window; what they
    make of all commands together has to be the same, and where an effect remembers more, the window is the whole run.
    """
    first = loops[0]
    m = ticks_per_period(first.law.period)
    time: FloatArray = first.law.period / m * np.arange(len(first.setpoint) * m + 1, dtype=np.float64)
    train, vehicle = first.plant.model.actuators, first.plant.vehicle
    where = bare_actuation(vehicle, time, train.subdivision)
    windows = [round(length / first.law.period * m) for length in _WINDOWS]
    for window in (*windows, len(time)):
        courses = _run(loops, time, where, window)
        if window >= len(time) or train.is_plain:
            break
        wholes = [train.torque_inputs(CommandSeries(vehicle, where, course.commands)) for course in courses]
        if all(_is_forgotten(whole, course.drive) for whole, course in zip(wholes, courses, strict=True)):
            break
    return courses


def _is_forgotten(whole: TorqueInput, seen: TorqueInput) -> bool:
    """Whether what was before the window makes no difference to the torque, nor to what terms are told beside it."""
    everything = np.column_stack((whole.torque, whole.effect_inputs))
    looked_back = np.column_stack((seen.torque, seen.effect_inputs))
    reach = _FORGOTTEN * np.maximum(np.max(np.abs(everything), axis=0), 1e-9)
    return bool(np.all(np.abs(everything - looked_back)[:-1] <= reach))


def _run(loops: Sequence[ClosedLoop], time: FloatArray, where: ActuatorInputs, window: int) -> list[ClosedLoopRun]:
    """From sample to sample, looking back upon so many ticks; all effects between command and torque act together."""
    plant, m, shape = loops[0].plant, ticks_per_period(loops[0].law.period), (len(loops), len(time))
    asked, torque, moment = np.zeros((3, *shape))
    commands, beside = np.zeros((*shape, len(plant.vehicle.thrusters))), np.zeros((*shape, 1 + len(SPEEDS)))
    courses = [
        _begun(loop, time, *its) for loop, *its in zip(loops, asked, commands, torque, moment, beside, strict=True)
    ]
    running = [_steps(loop, course) for loop, course in zip(loops, courses, strict=True)]
    inverses = {loop.allocation: [one.allocation is loop.allocation for one in loops] for loop in loops}
    for at in range(0, len(time) - 1, m):
        for one in running:
            next(one)
        for allocation, its in inverses.items():
            commands[its, at : at + m + 1] = allocation(asked[its, at])[:, None]
        made = _latest(plant, where, commands[:, : at + m + 1], max(at - window, 0), m)
        for series, latest in zip((torque, moment, beside), made, strict=True):
            series[:, at : at + m] = latest
    for one in running:
        next(one, None)
    return courses


def _begun(
    loop: ClosedLoop,
    time: FloatArray,
    asked: FloatArray,
    commands: FloatArray,
    torque: FloatArray,
    moment: FloatArray,
    beside: FloatArray,
) -> ClosedLoopRun:
    """Before its first step."""
    n, m, wanted = len(time), ticks_per_period(loop.law.period), loop.setpoint
    return ClosedLoopRun(
        time=time,
        heading=np.full(n, loop.initial_heading),
        rate=np.zeros(n),
        setpoint=np.append(np.repeat(wanted, m), wanted[-1]),
        torque=asked,
        commands=commands,
        external_torque=_from_outside(loop, time),
        drive=TorqueInput(torque, moment, beside, np.zeros(n), np.array([0, n])),
    )


def _steps(loop: ClosedLoop, course: ClosedLoopRun) -> Iterator[None]:
    """Fill in ``course``: at each sample the torque that is asked for, whose drive has to be there to go on.

    Its heading is the true one until the end, and then what the instrument shows.
    """
    from rovid.model.kernels import SCRATCH_ROWS, advance

    law, plant, heading, drive = loop.law, loop.plant, course.heading, course.drive
    model, m, tick = plant.model, ticks_per_period(law.period), float(course.time[1])
    noise = np.random.default_rng([loop.seed, 1]).normal(0.0, 1.0, len(loop.setpoint)) * plant.heading_noise
    equation, deviates = model.equation(loop.initial_heading), model.heading_sensor.deviates
    rows = TERM_STATES * len(equation.terms.kinds)
    states, work = np.zeros((rows, LANES)), np.zeros((3, rows + SCRATCH_ROWS, LANES))
    rate, angle, stiffness, state = 0.0, 0.0, 0.0, None
    for k in range(len(loop.setpoint)):
        at = k * m
        read = float(_at(heading, at - plant.delay / tick))
        if deviates:
            read += float(model.heading_sensor.deviation(np.array([read]))[0])
        read += noise[k]
        state = law.initial_state(read) if state is None else state
        course.torque[at : at + m], state = law.step(state, read, float(loop.setpoint[k]))
        yield
        for j in range(at, at + m):
            told = drive.torque[j], course.external_torque[j], drive.timing_moment[j], drive.effect_inputs[j]
            rate, angle, stiffness = advance(rate, angle, *told, tick, equation, states, work, stiffness)
            heading[j + 1], course.rate[j + 1] = loop.initial_heading + angle, rate
    for series in (course.torque, drive.torque, drive.effect_inputs):
        series[-1] = series[-2]
    if deviates:
        heading += model.heading_sensor.deviation(heading)


def _latest(
    plant: Plant, where: ActuatorInputs, commands: FloatArray, first: int, m: int
) -> tuple[FloatArray, FloatArray | float, FloatArray | float]:
    """(l, m) torque and moment, and (l, m, 3) what is beside, that (l, n, k) ``commands`` make in the last ``m`` ticks.

    Or what is the same in all of them. Commands from before the tick ``first`` are not looked at.
    """
    model, vehicle, (count, last, k) = plant.model, plant.vehicle, commands.shape
    if model.actuators.is_plain:
        return (vehicle.thrust(commands[:, -1]) @ where.arms)[:, None], 0.0, 0.0
    length, parts = last - first, where.subdivision
    trials, intervals = _side_by_side(float(where.time[parts]), parts, length - 1, count)
    time = np.tile(where.time[first * parts : (last - 1) * parts + 1], count)
    held = commands[:, first:].reshape(-1, k)
    drive = model.actuators.torque_inputs(
        CommandSeries(vehicle, replace(where, time=time, trials=trials), held), intervals
    )
    torque, moment = drive.torque.reshape(count, length), drive.timing_moment.reshape(count, length)
    latest = slice(-m - 1, -1)
    return torque[:, latest], moment[:, latest], drive.effect_inputs.reshape(count, length, -1)[:, latest]


# The whole window is asked for at each tick, once it has passed.
@functools.lru_cache(maxsize=4)
def _side_by_side(tick: float, parts: int, length: int, count: int) -> tuple[tuple[TrialRows, ...], Intervals | None]:
    """Stretches of ``length`` ticks of ``tick`` s, each cut into ``parts``, and their intervals where that is so."""
    at = parts * np.arange(length + 1)
    ends = range(at[-1] + 1, count * (at[-1] + 1) + 1, at[-1] + 1)
    trials = tuple(TrialRows(rows=slice(end - at[-1] - 1, end)) for end in ends)
    if parts == 1:
        return trials, None
    return trials, Intervals.from_times([tick / parts * np.arange(at[-1] + 1)] * count, [at] * count)


def _at(values: FloatArray, place: float) -> float:
    """Linear between the values at whole places; the first before."""
    if place <= 0.0:
        return float(values[0])
    whole = int(place)
    share = place - whole
    if share == 0.0:
        return float(values[whole])
    return float(values[whole] + share * (values[whole + 1] - values[whole]))


def _from_outside(loop: ClosedLoop, time: FloatArray) -> FloatArray:
    """(n,) N m: the torque from outside, the coloured disturbance, and the model's waves where it is not quiet."""
    plant, rng = loop.plant, np.random.default_rng([loop.seed, 0])
    total = np.zeros(len(time))
    if loop.external_torque is not None:
        total += np.append(np.repeat(loop.external_torque, ticks_per_period(loop.law.period)), loop.external_torque[-1])
    if plant.disturbance > 0.0:
        total += gauss_markov(time, plant.disturbance, plant.correlation_time, rng)
    wave = plant.model.wave_parameters
    if wave.size and (plant.disturbance > 0.0 or plant.heading_noise > 0.0):
        amplitude, frequency, damping = wave
        size, memory = amplitude / math.sqrt(2.0), 1.0 / (damping * frequency)
        # A narrow band about a frequency: two slow amplitudes in quadrature.
        total += gauss_markov(time, size, memory, rng) * np.cos(frequency * time)
        total += gauss_markov(time, size, memory, rng) * np.sin(frequency * time)
    return total


def gauss_markov(time: FloatArray, size: float, memory: float, rng: np.random.Generator) -> FloatArray:
    """(n,) first-order Gauss-Markov series of standard deviation ``size`` and correlation time ``memory`` in s."""
    fade = math.exp(-float(time[1] - time[0]) / memory)
    kicks = rng.normal(0.0, size * math.sqrt(1.0 - fade**2), len(time))
    # The series begins with all the size that it is to have.
    kicks[0] = rng.normal(0.0, size)
    return first_order_sum(kicks, fade)
