"""Equation of motion in yaw with every cause, by the fourth-order Runge-Kutta method at a fixed fine step.

All compiled functions stand in this file: numba checks this file alone for changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, ParamSpec, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_Signature = ParamSpec("_Signature")
_Result = TypeVar("_Result")

SEND, ARRIVE, SAMPLE = range(3)  # kinds of events, in their order at one instant
DISTURBANCE, SURGE, DRIFT, VOLTAGE, N_SERIES = range(5)
FORWARD, ZONE_AHEAD, ZONE_ASTERN, ARM = range(4)  # columns of the thrusters
PSI, RATE, WATER, WATER_2, SLOSH, SLOSH_RATE, SWAY, SAG, N_STATE = range(9)
NO_LAG, OF_TORQUE, OF_COMMAND, OF_SPIN, OF_ROTOR, IN_SERIES = range(6)


def compiled(function: Callable[_Signature, _Result]) -> Callable[_Signature, _Result]:
    """The function as machine code, kept between runs."""
    return cast("Callable[_Signature, _Result]", numba.njit(cache=True, error_model="numpy")(function))


class Physics(NamedTuple):
    """Vehicle and cause; commands are shares of full command. A default means that the cause does not act."""

    inertia: float  # kg m2
    quadratic: float  # N m s2/rad2
    linear: float  # N m s/rad
    # Commands
    slew_up: float = math.inf  # 1/s
    slew_down: float = math.inf
    play: float = 0.0
    schmitt: float = 0.0
    deadband: float = 0.0
    edge: float = 0.0  # width of a smooth edge of the dead band
    jump: float = 0.0
    command_power: float = 1.0
    # Thrust
    lag: float = 0.0  # s
    lag_kind: float = 0.0
    second_lag: float = 0.0  # s
    reverse: float = 1.0
    reverse_grows: float = 0.0
    weak: float = 1.0
    weak_index: float = -1.0
    weak_beside: float = 0.0
    power: float = 1.0
    saturating: float = 0.0
    sag: float = 0.0
    sag_time: float = 1.0  # s
    fade: float = 0.0  # 1/s since the log began
    day_fade: float = 0.0  # 1/s since the first log began
    voltage_power: float = 0.0
    advance: float = 0.0  # N^0.5 s/m
    advance_curved: float = 0.0
    advance_surge: float = 0.0  # N^0.5 s/m
    # Drag
    bias: float = 0.0  # N m
    cubic: float = 0.0  # N m s3/rad3
    exponent: float = 2.0
    crisis: float = 0.0
    full_rate: float = 1.0  # rad/s, where an exponent or a crisis counts from
    astern_drag: float = 1.0
    astern_quadratic: float = 1.0
    coulomb: float = 0.0  # N m
    coulomb_rate: float = 1.0  # rad/s
    stribeck: float = 0.0
    stribeck_rate: float = 1.0  # rad/s
    oscillatory: float = 0.0
    oscillatory_angle: float = 1.0  # rad
    algebraic: float = 0.0
    # Water
    memory: float = 0.0  # kg m2
    memory_time: float = 1.0  # s
    second_memory: float = 0.0  # kg m2
    second_time: float = 1.0  # s
    porous_rate: float = 0.0  # rad/s; 0: linear
    swirl: float = 0.0
    swirl_time: float = 1.0  # s
    annulus: float = 0.0  # kg m2 of the water that turns along
    annulus_brake: float = 0.0  # N m s2/rad2
    seiche: float = 0.0
    seiche_frequency: float = 1.0  # rad/s
    seiche_damping: float = 0.1
    seiche_by_thrust: float = 0.0
    # Heading and speeds
    tether: float = 0.0  # N m/rad
    tether_angle: float = math.inf  # rad, where stiffness is doubled
    tether_fixed: float = 0.0  # 1: slack at heading 0 rather than at the start
    once: float = 0.0  # N m
    once_phase: float = 0.0
    twice: float = 0.0  # N m
    twice_phase: float = 0.0
    speed_linear: float = 0.0
    speed_quadratic: float = 0.0
    sideslip: float = 0.0  # N s
    munk: float = 0.0  # kg
    # Sway that answers the turn: sway_time * dv/dt = drift - v - sway_gain * surge * r
    sway_time: float = 1.0
    sway_gain: float = 0.0


class Pilot(NamedTuple):
    """Who commands: ``angle`` above 0 makes a zigzag between plus and minus this heading (rad) from the start."""

    angle: float = 0.0
    demand: float = 0.0


@compiled
def _curve(share: float, x: Floats, y: Floats) -> float:
    """Thrust in N of a command by linear interpolation of the bench table."""
    low, high = 0, x.size - 1
    if share <= x[0]:
        return float(y[0])
    if share >= x[high]:
        return float(y[high])
    while high - low > 1:
        middle = (low + high) // 2
        if x[middle] <= share:
            low = middle
        else:
            high = middle
    return float(y[low] + (y[high] - y[low]) * (share - x[low]) / (x[high] - x[low]))


@compiled
def _aimed(command: float, thruster: Floats, ph: Physics) -> float:
    """Command after dead band and shape."""
    size = abs(command)
    if ph.deadband > 0.0:
        if ph.jump > 0.0:
            zone = thruster[ZONE_AHEAD] if command > 0.0 else thruster[ZONE_ASTERN]
            size = size if size >= zone + ph.deadband else 0.0
        elif ph.edge > 0.0:
            # A hyperbola between the two straight lines, zero at zero.
            away = size - ph.deadband
            lift = 0.5 * (math.sqrt(ph.deadband**2 + ph.edge**2) - ph.deadband)
            size = 0.5 * (away + math.sqrt(away * away + ph.edge**2)) - lift
        else:
            size = max(size - ph.deadband, 0.0)
    if ph.command_power != 1.0:
        zone = thruster[ZONE_AHEAD] if command > 0.0 else thruster[ZONE_ASTERN]
        if size > zone:
            size = zone + (1.0 - zone) * ((size - zone) / (1.0 - zone)) ** ph.command_power
    return math.copysign(size, command)


@compiled
def _switched(command: float, before: float, running: float, thruster: Floats, ph: Physics) -> tuple[float, float]:
    """Command after play or a switch-on threshold, and whether the drive runs."""
    if ph.play > 0.0:
        return min(max(before, command - 0.5 * ph.play), command + 0.5 * ph.play), running
    if ph.schmitt > 0.0:
        zone = thruster[ZONE_AHEAD] if command > 0.0 else thruster[ZONE_ASTERN]
        if abs(command) <= zone + 1e-9 or running * command < 0.0:
            running = 0.0
        if abs(command) > zone + ph.schmitt:
            running = math.copysign(1.0, command)
        return (command if running != 0.0 else 0.0), running
    return command, running


@compiled
def _half_step(
    h: float, wanted: float, slewed: float, aux: float, thrust: float, thruster: Floats, x: Floats, y: Floats,
    ph: Physics,
) -> tuple[float, float, float]:  # fmt: skip
    """Slewed command, inner state of the lag and thrust in N after ``h`` seconds of a constant command."""
    if wanted != slewed:
        rate = ph.slew_up if (wanted - slewed) * slewed >= 0.0 else ph.slew_down
        if (wanted - slewed) * slewed < 0.0 and ph.slew_down == math.inf:
            slewed = wanted if wanted * slewed > 0.0 else 0.0  # thrust falls at once
            rate = ph.slew_up
        if rate < math.inf:
            slewed += min(max(wanted - slewed, -rate * h), rate * h)
        else:
            slewed = wanted
    kind = ph.lag_kind
    if kind == OF_COMMAND:
        aux = slewed + (aux - slewed) * math.exp(-h / ph.lag)
        return slewed, aux, _curve(_aimed(aux, thruster, ph), x, y)
    aim = _curve(_aimed(slewed, thruster, ph), x, y)
    if kind == OF_TORQUE:
        return slewed, aux, aim + (thrust - aim) * math.exp(-h / ph.lag)
    if kind == IN_SERIES:
        early = (aux - aim) * ph.lag / (ph.lag - ph.second_lag)
        late = thrust - aim - early
        first, second = math.exp(-h / ph.lag), math.exp(-h / ph.second_lag)
        return slewed, aim + (aux - aim) * first, aim + early * first + late * second
    if kind == OF_SPIN:
        spin = math.copysign(math.sqrt(abs(thrust)), thrust)
        target = math.copysign(math.sqrt(abs(aim)), aim)
        spin = target + (spin - target) * math.exp(-h / ph.lag)
        return slewed, aux, spin * abs(spin)
    if kind == OF_ROTOR:
        spin = math.copysign(math.sqrt(abs(thrust)), thrust)
        scale = 2.0 * ph.lag * math.sqrt(0.1 * thruster[FORWARD])
        k1 = (aim - spin * abs(spin)) / scale
        mid = spin + 0.5 * h * k1
        k2 = (aim - mid * abs(mid)) / scale
        mid = spin + 0.5 * h * k2
        k3 = (aim - mid * abs(mid)) / scale
        end = spin + h * k3
        k4 = (aim - end * abs(end)) / scale
        spin += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return slewed, aux, spin * abs(spin)
    return slewed, aux, aim


@compiled
def _torque(
    base: Floats, thrusters: Floats, r: float, sag: float, surge: float, voltage: float, t: float, day: float,
    ph: Physics,
) -> tuple[float, float]:  # fmt: skip
    """Yaw torque in N m of all thrusters, and their load as a share of full thrust."""
    total, load, most = 0.0, 0.0, 0.0
    for i in range(base.size):
        force = base[i]
        full = thrusters[i, FORWARD]
        load += abs(force)
        most += full
        if ph.power != 1.0:
            force = math.copysign(0.1 * full * (abs(force) / (0.1 * full)) ** ph.power, force)
        if ph.saturating != 0.0:
            force *= (1.0 + ph.saturating) / (1.0 + ph.saturating * abs(force) / (0.1 * full))
        if force < 0.0 and ph.reverse != 1.0:
            loss = 1.0 - ph.reverse
            force *= 1.0 - (loss * abs(force) / full if ph.reverse_grows > 0.0 else loss)
        if ph.weak_index == i:
            beside = False
            for j in range(base.size):
                beside = beside or (j != i and abs(base[j]) > 0.01 * thrusters[j, FORWARD])
            if ph.weak_beside == 0.0 or beside:
                force *= ph.weak
        if ph.advance != 0.0 and force != 0.0:
            ratio = ph.advance * thrusters[i, ARM] * r * math.copysign(1.0, force) / math.sqrt(abs(force))
            if ph.advance_curved > 0.0:
                ratio = min(max(ratio, -0.6), 0.6)
                ratio = ratio + 2.5 * ratio**2 - 1.8 * ratio**3
            force -= force * ratio
        if ph.advance_surge != 0.0:
            force = math.copysign(max(abs(force) - ph.advance_surge * math.sqrt(abs(force)) * abs(surge), 0.0), force)
        total += thrusters[i, ARM] * force
    total *= (1.0 - ph.sag * sag) * max(1.0 - ph.fade * t - ph.day_fade * (t + day), 0.0)
    if ph.voltage_power != 0.0:
        total *= voltage**ph.voltage_power
    return total, load / most


@compiled
def _drag(r: float, swept: float, ph: Physics) -> float:
    """Drag in N m at a rate through the water."""
    size = abs(r)
    quadratic = ph.quadratic * size * r
    if ph.exponent != 2.0:
        quadratic = ph.quadratic * ph.full_rate**2 * math.copysign((size / ph.full_rate) ** ph.exponent, r)
    if ph.crisis != 0.0:
        quadratic *= 1.0 - ph.crisis * size**4 / (size**4 + (0.5 * ph.full_rate) ** 4)
    if ph.oscillatory != 0.0:
        angle = swept / ph.oscillatory_angle
        quadratic *= 1.0 + ph.oscillatory * (1.0 / (1.0 + angle) if ph.algebraic > 0.0 else math.exp(-angle))
    linear = ph.linear * r
    if r < 0.0:
        quadratic *= ph.astern_quadratic * ph.astern_drag
        linear *= ph.astern_drag
    return quadratic + linear + ph.cubic * r**3


@compiled
def _slopes(
    t: float, state: Floats, base: Floats, thrusters: Floats, series: Floats, swept: float, start: float, day: float,
    ph: Physics, out: Floats,
) -> None:  # fmt: skip
    """Derivatives of the state into ``out``."""
    psi, r, w, sway = state[PSI], state[RATE], state[WATER], state[SWAY]
    surge = series[SURGE]
    thrust, load = _torque(base, thrusters, r, state[SAG], surge, series[VOLTAGE], t, day, ph)
    for j in range(N_STATE):  # a slice takes numba a second to compile
        out[j] = 0.0
    n = thrust + series[DISTURBANCE] + ph.bias
    if ph.annulus > 0.0:
        drag = _drag(r - w, swept, ph)
        out[WATER] = (drag - ph.annulus_brake * abs(w) * w) / ph.annulus
    else:
        drag = _drag(r - ph.swirl * w, swept, ph)
    n -= drag
    if ph.swirl != 0.0:
        out[WATER] = (r - w) / ph.swirl_time
    if ph.memory != 0.0:
        slip = (r - w) * (abs(r - w) / ph.porous_rate if ph.porous_rate > 0.0 else 1.0)
        out[WATER] = slip / ph.memory_time
        n -= ph.memory * out[WATER]
    if ph.second_memory != 0.0:
        out[WATER_2] = (r - state[WATER_2]) / ph.second_time
        n -= ph.second_memory * out[WATER_2]
    if ph.coulomb != 0.0:
        n -= (
            ph.coulomb * math.tanh(r / ph.coulomb_rate) * (1.0 + ph.stribeck * math.exp(-((r / ph.stribeck_rate) ** 2)))
        )
    if ph.tether != 0.0:
        turned = psi - (0.0 if ph.tether_fixed > 0.0 else start)
        n -= ph.tether * turned * (1.0 + (turned / ph.tether_angle) ** 2)
    n += ph.once * math.sin(psi + ph.once_phase) + ph.twice * math.sin(2.0 * psi + ph.twice_phase)
    n -= (ph.speed_linear * abs(surge) + ph.speed_quadratic * surge * surge) * r
    n -= ph.sideslip * sway + ph.munk * surge * sway
    if ph.seiche != 0.0:
        n -= ph.seiche * ph.inertia * ph.seiche_frequency * state[SLOSH_RATE]
    turn = n / ph.inertia
    if ph.seiche != 0.0:
        source = thrust / ph.inertia if ph.seiche_by_thrust > 0.0 else turn
        out[SLOSH] = state[SLOSH_RATE]
        own = 2.0 * ph.seiche_damping * ph.seiche_frequency * state[SLOSH_RATE]
        out[SLOSH_RATE] = source - own - ph.seiche_frequency**2 * state[SLOSH]
    out[PSI] = r
    out[RATE] = turn
    out[SWAY] = (series[DRIFT] - sway - ph.sway_gain * surge * r) / ph.sway_time
    out[SAG] = (load - state[SAG]) / ph.sag_time


@compiled
def _at(t: float, begin: float, step: float, series: Floats, out: Floats) -> None:
    """Series at an instant, by linear interpolation."""
    place = min(max((t - begin) / step, 0.0), series.shape[0] - 1.001)
    k = int(place)
    share = place - k
    for j in range(out.size):
        out[j] = series[k, j] + share * (series[k + 1, j] - series[k, j])


@compiled
def _drive(
    h: float, switched: Floats, slewed: Floats, aux: Floats, base: Floats, thrusters: Floats, x: Floats, y: Floats,
    ph: Physics,
) -> None:  # fmt: skip
    """Thrusts (3, n) in N at the start, the middle and the end of a step."""
    for i in range(switched.size):
        for half in range(2):
            slewed[i], aux[i], base[half + 1, i] = _half_step(
                0.5 * h, switched[i], slewed[i], aux[i], base[half, i], thrusters[i], x[i], y[i], ph
            )
        if ph.lag_kind == NO_LAG and ph.slew_up == math.inf:
            base[0, i] = base[1, i]


@compiled
def _step(
    begin: float, h: float, state: Floats, trial: Floats, slopes: Floats, base: Floats, thrusters: Floats, now: Floats,
    swept: float, heading: float, day: float, ph: Physics,
) -> None:  # fmt: skip
    """Advance the state by one step of the fourth-order Runge-Kutta method."""
    for stage in range(4):
        half = (stage + 1) // 2
        onward = 0.0 if stage == 0 else h if stage == 3 else 0.5 * h
        for j in range(N_STATE):
            trial[j] = state[j] + onward * slopes[stage - 1, j]
        _slopes(begin + onward, trial, base[half], thrusters, now[half], swept, heading, day, ph, slopes[stage])
    for j in range(N_STATE):
        state[j] += h / 6.0 * (slopes[0, j] + 2.0 * slopes[1, j] + 2.0 * slopes[2, j] + slopes[3, j])


@compiled
def simulate(
    ph: Physics, pilot: Pilot, thrusters: Floats, x: Floats, y: Floats, times: Floats, kinds: Ints, places: Ints,
    commands: Floats, mix: Floats, series_begin: float, series_step: float, series: Floats, heading: float, day: float,
    longest: float, record: Floats,
) -> None:  # fmt: skip
    """Simulate a run from rest through its events.

    Parameters
    ----------
    thrusters, x, y
        (n, 4); shares of full command (n, m) and thrusts in N (n, m) of the bench tables.
    times, kinds, places
        Events in order: a command of that row is sent, or arrives, or that row of ``record`` is due.
    commands
        (k, n), shares of full command; a zigzag's pilot writes them when they are sent, by ``mix`` (n,).
    day
        Seconds from the first log's start to this one's.
    longest
        Longest step of the integration, in s.
    record
        (samples, 4): heading in rad, rate in rad/s, speed ahead and to starboard in m/s.
    """
    count = thrusters.shape[0]
    state = np.zeros(N_STATE)
    state[PSI] = heading
    trial = np.zeros(N_STATE)
    slopes = np.zeros((4, N_STATE))
    arrived = np.zeros(count)
    switched = np.zeros(count)
    running = np.zeros(count)
    slewed = np.zeros(count)
    aux = np.zeros(count)
    base = np.zeros((3, count))
    now = np.zeros((3, N_SERIES))
    swept, side, sense = 0.0, 0.0, 1.0
    t = times[0]
    for event in range(times.size):
        span = times[event] - t
        steps = math.ceil(span / longest - 1e-9) if span > 1e-12 else 0
        for k in range(steps):
            h = span / steps
            begin = t + k * h
            _drive(h, switched, slewed, aux, base, thrusters, x, y, ph)
            for half in range(3):
                _at(begin + 0.5 * half * h, series_begin, series_step, series, now[half])
            _step(begin, h, state, trial, slopes, base, thrusters, now, swept, heading, day, ph)
            for i in range(count):
                base[0, i] = base[2, i]
            if state[RATE] * side < 0.0:
                swept = 0.0
            side = state[RATE]
            swept += abs(state[RATE]) * h
        t = times[event]
        place = places[event]
        if kinds[event] == SEND:
            if pilot.angle > 0.0:
                if sense * (state[PSI] - heading) > pilot.angle:
                    sense = -sense
                for i in range(count):
                    commands[place, i] = mix[i] * sense * pilot.demand
        elif kinds[event] == ARRIVE:
            for i in range(count):
                arrived[i] = commands[place, i]
                switched[i], running[i] = _switched(arrived[i], switched[i], running[i], thrusters[i], ph)
        else:
            _at(t, series_begin, series_step, series, now[0])
            record[place, 0] = state[PSI]
            record[place, 1] = state[RATE]
            record[place, 2] = now[0, SURGE]
            record[place, 3] = state[SWAY]
