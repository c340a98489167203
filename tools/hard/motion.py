"""Surge, sway and yaw together: the run of a campaign, fourth-order Runge-Kutta at a fine fixed step."""

from __future__ import annotations

import math

import numpy as np

from tools.hard.layout import (
    ARM,
    AUTOPILOT,
    BACKWARD,
    COS,
    CROSS_FLOW,
    DEMAND_LIMIT,
    DEVIATION_1,
    DEVIATION_1_PHASE,
    DEVIATION_2,
    DEVIATION_2_PHASE,
    DL,
    DQ,
    DRIFT,
    EDDY,
    EDDY_YAW,
    FORWARD,
    GAIN_D,
    GAIN_I,
    GAIN_P,
    GUST,
    LENGTH,
    M11,
    M22,
    M23,
    M33,
    N_UR,
    N_UV,
    OPEN_LOOP,
    POD,
    R_BENCH,
    R_PSI,
    R_RATE,
    R_SURGE,
    R_SWAY,
    R_TORQUE,
    R_TORQUE_PLAIN,
    R_WATER_0,
    R_WATER_1,
    R_WAVES,
    SAG,
    SAG_TIME,
    SCALE,
    SIN,
    STICK_DELAY,
    STICK_LEVELS,
    SWELL,
    SWELL_MOMENT,
    WAVE,
    WAVE_DIRECTION,
    WAVE_DRIFT,
    WAVE_DRIFT_YAW,
    WAVE_QUADRATURE,
    WAVE_SURGE,
    WAVE_SWAY,
    WAVE_YAW,
    WIND_DIRECTION,
    WIND_SURGE,
    WIND_SWAY,
    WIND_YAW,
    X_U,
    X_UU,
    Y_V,
    Y_VV,
    ZIGZAG,
    ZIGZAG_ANGLE,
    Floats,
    Ints,
    compiled,
)
from tools.hard.thrust import aimed, bench, delivered, gain, through_the_drive
from tools.hard.water import moment

# Where the strips of the cross-flow drag lie along the hull, and their weights (Gauss-Legendre, 4 points a half).
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
STRIPS = np.concatenate([-(_NODES[::-1] + 1) / 4, (_NODES + 1) / 4])
STRIP_WEIGHTS = np.concatenate([_WEIGHTS[::-1], _WEIGHTS]) / 4


@compiled
def cross_flow(v: float, r: float, hull: Floats) -> tuple[float, float]:
    """Sway force and yaw moment of a hull that is cut into strips, each with its own cross flow."""
    force = 0.0
    turning = 0.0
    for strip in range(STRIPS.size):
        place = STRIPS[strip] * hull[LENGTH]
        flow = v + place * r
        share = hull[CROSS_FLOW] * STRIP_WEIGHTS[strip] * hull[LENGTH] * abs(flow) * flow
        force -= share
        turning -= place * share
    return force, turning


@compiled
def push(
    spins: Floats, thrusters: Floats, cause: Floats, sag: float, scale: float, motion: Floats, out: Floats
) -> None:
    """Force ahead, to the side, and torque of all thrusters."""
    out[:] = 0.0
    for index in range(spins.size):
        thruster = thrusters[index]
        thrust = delivered(spins[index], thruster, cause, motion[0], motion[1], motion[2])
        thrust *= gain(thrust, index, cause) * (1.0 - cause[SAG] * sag) * scale
        out[0] += thruster[COS] * thrust
        out[1] += thruster[SIN] * thrust
        out[2] += thruster[ARM] * thrust
        if thruster[POD] > 0.0:  # the pod pulls at one speed; what it does not push aside it pushes ahead
            out[0] += math.sqrt(max(thruster[FORWARD] ** 2 - thrust * thrust, 0.0))


@compiled
def rates(
    state: Floats, pushed: Floats, series: Floats, hull: Floats, weather: Floats, cause: Floats, out: Floats
) -> None:
    """Rates of (u, v, r, psi, two states of the water), and the waves' moment; speeds are through the water."""
    u, v, r, psi = state[0], state[1], state[2], state[3]
    angle = weather[WAVE_DIRECTION] - psi
    ahead, beam, quartering = math.cos(angle), math.sin(angle), math.sin(2.0 * angle)
    wave, quadrature = series[WAVE], series[WAVE_QUADRATURE]
    envelope = 0.5 * (wave * wave + quadrature * quadrature)
    wind = weather[WIND_DIRECTION] - psi
    gust = series[GUST]

    x = pushed[0] - hull[X_U] * u - hull[X_UU] * abs(u) * u
    x += weather[WAVE_SURGE] * quadrature * ahead + weather[WAVE_DRIFT] * envelope * ahead
    x += weather[WIND_SURGE] * gust * math.cos(wind)
    strip_y, strip_n = cross_flow(v, r, hull)
    _, turning_alone = cross_flow(0.0, r, hull)
    y = pushed[1] - hull[Y_V] * v - hull[Y_VV] * abs(v) * v + strip_y
    y += weather[WAVE_SWAY] * wave * beam + weather[WAVE_DRIFT] * envelope * beam
    y += weather[WIND_SWAY] * gust * math.sin(wind)
    # The drag of turning alone stands in `moment`, where causes act on it; the strips add what sway does to it.
    n = pushed[2] + strip_n - turning_alone - hull[N_UV] * u * v - hull[N_UR] * abs(u) * r
    n += moment(r, psi, u, v, state[4:6], cause, hull[DQ], hull[DL], out[4:6])
    waves = weather[WAVE_YAW] * (wave * quartering + 0.5 * quadrature * ahead)
    waves += weather[WAVE_DRIFT_YAW] * envelope * quartering
    n += waves
    n += weather[WIND_YAW] * gust * math.sin(2.0 * wind) + weather[EDDY_YAW] * series[EDDY]
    n += cause[SWELL] * series[SWELL_MOMENT]

    # Coriolis and centripetal, rigid body and added mass together; the Munk moment is in it.
    x += (hull[M22] * v + hull[M23] * r) * r
    y -= hull[M11] * u * r
    n += hull[M11] * u * v - (hull[M22] * v + hull[M23] * r) * u
    determinant = hull[M22] * hull[M33] - hull[M23] * hull[M23]
    out[0] = x / hull[M11]
    out[1] = (hull[M33] * y - hull[M23] * n) / determinant
    out[2] = (hull[M22] * n - hull[M23] * y) / determinant
    out[3] = r
    out[6] = waves


@compiled
def shortest(angle: float) -> float:
    """The same angle between half a turn either way."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@compiled
def demanded(
    mode: int, pilot: Floats, wanted: Floats, decide: Ints, tick: int, seen: Floats, rate: Floats, memory: Floats
) -> float:
    """Demand in yaw from -1 to 1: of a programme, an autopilot, a zigzag, or a person who looks late."""
    if mode == OPEN_LOOP:
        return float(wanted[tick])
    if mode == ZIGZAG:
        if memory[0] == 0.0:
            memory[0] = 1.0
        away = seen[tick] - wanted[tick]
        if away * memory[0] > pilot[ZIGZAG_ANGLE]:
            memory[0] = -memory[0]
        return float(memory[0] * pilot[DEMAND_LIMIT])
    if mode == AUTOPILOT:
        error = shortest(wanted[tick] - seen[tick])
        demand = pilot[GAIN_P] * error - pilot[GAIN_D] * rate[tick] + memory[0]
        held = min(max(demand, -pilot[DEMAND_LIMIT]), pilot[DEMAND_LIMIT])
        if held == demand:  # no winding up
            memory[0] += pilot[GAIN_I] * error
        return float(held)
    if decide[tick] > 0:
        late = max(tick - int(pilot[STICK_DELAY]), 0)
        error = shortest(wanted[tick] - seen[late])
        demand = pilot[GAIN_P] * error - pilot[GAIN_D] * rate[late]
        levels = pilot[STICK_LEVELS]
        memory[0] = round(min(max(demand, -1.0), 1.0) * levels) / levels * pilot[DEMAND_LIMIT]
    return float(memory[0])


@compiled
def deviation(psi: float, cause: Floats) -> float:
    """What a compass adds to the heading."""
    once = cause[DEVIATION_1] * math.sin(psi - cause[DEVIATION_1_PHASE])
    return float(once + cause[DEVIATION_2] * math.sin(2.0 * (psi - cause[DEVIATION_2_PHASE])))


@compiled
def turn_rotors(
    commands: Floats, law: Floats, thrusters: Floats, rotors: Floats, step: float, through: Floats, running: Floats,
    spins: Floats, spin_rate: Floats,
) -> None:  # fmt: skip
    """Rotors through a step: what the drive makes of the commands, then two half steps towards what the curve asks."""
    for index in range(commands.size):
        through[index], running[index] = through_the_drive(commands[index], through[index], running[index], step, law)
        force = aimed(through[index], thrusters[index], law)
        aim = force if thrusters[index, POD] > 0.0 else math.copysign(math.sqrt(abs(force)), force)
        for half in range(2):
            away = spins[half, index] - aim
            spins[half + 1, index] = aim + rotors[index, 0, 0] * away + rotors[index, 0, 1] * spin_rate[index]
            spin_rate[index] = rotors[index, 1, 0] * away + rotors[index, 1, 1] * spin_rate[index]


@compiled
def load(spins: Floats, thrusters: Floats) -> float:
    """Thrust of all thrusters over the most that they have."""
    total = 0.0
    most = 0.0
    for index in range(spins.size):
        spin = abs(spins[index])
        total += spin if thrusters[index, POD] > 0.0 else spin * spin
        most += max(thrusters[index, FORWARD], thrusters[index, BACKWARD])
    return total / most


@compiled
def run(
    start: Floats, step: float, every: int, hull: Floats, thrusters: Floats, weather: Floats, series: Floats,
    cause: Floats, plain: Floats, rotors: Floats, delays: Ints, mix_yaw: Floats, mix_surge: Floats, fineness: float,
    mode: int, pilot: Floats, wanted: Floats, surge: Floats, decide: Ints, noise: Floats, rate_noise: Floats,
    record: Floats, commands: Floats,
) -> None:  # fmt: skip
    """Simulate a run; ``record`` gets a row a step, ``commands`` a row a tick of the control (``every`` steps).

    Rotors run twice on the same commands, with the cause (bank 0) and without it (bank 1), so that its part in the
    torque is known. ``rotors`` holds for each bank and thruster the matrix of half a step.
    """
    count = thrusters.shape[0]
    state = start.copy()
    seen = np.zeros(wanted.size)
    rate = np.zeros(wanted.size)
    memory = np.zeros(2)
    through = np.zeros((2, count))
    running = np.zeros((2, count))
    spins = np.zeros((2, 3, count))  # at the step's start, middle and end
    spin_rate = np.zeros((2, count))
    sag = 0.0
    pushed = np.zeros((3, 3))
    without = np.zeros(3)
    slopes = np.zeros((4, 7))
    trial = np.zeros(6)
    arrived = np.zeros(count)  # the latest command that has come through by now
    for k in range(record.shape[0]):
        tick = k // every
        if k % every == 0:
            seen[tick] = state[3] + deviation(state[3], cause) + noise[tick]
            rate[tick] = state[2] + rate_noise[tick]
            demand = demanded(mode, pilot, wanted, decide, tick, seen, rate, memory)
            for index in range(count):
                asked = min(max(mix_yaw[index] * demand + mix_surge[index] * surge[tick], -1.0), 1.0)
                commands[tick, index] = round(asked * fineness) / fineness
        late = k - delays[tick]
        if late >= 0:
            for index in range(count):
                arrived[index] = commands[min(late // every, tick), index]
        turn_rotors(arrived, cause, thrusters, rotors[0], step, through[0], running[0], spins[0], spin_rate[0])
        turn_rotors(commands[tick], plain, thrusters, rotors[1], step, through[1], running[1], spins[1], spin_rate[1])
        push(spins[1, 0], thrusters, plain, 0.0, 1.0, state, without)
        scale = cause[SCALE] * (1.0 - cause[DRIFT] * k * step)
        for stage in range(4):
            moment_of = (stage + 1) // 2  # start, middle, middle, end
            onward = 0.0 if stage == 0 else step if stage == 3 else 0.5 * step
            for j in range(6):
                trial[j] = state[j] + onward * slopes[stage - 1, j]
            push(spins[0, moment_of], thrusters, cause, sag, scale, trial, pushed[moment_of])
            rates(trial, pushed[moment_of], series[2 * k + moment_of], hull, weather, cause, slopes[stage])
            if stage == 0:
                record[k, R_TORQUE] = pushed[0, 2]
        record[k, R_TORQUE_PLAIN] = without[2]
        record[k, R_WAVES] = slopes[0, 6]
        record[k, R_PSI], record[k, R_RATE] = state[3], state[2]
        record[k, R_SURGE], record[k, R_SWAY] = state[0], state[1]
        record[k, R_WATER_0], record[k, R_WATER_1] = state[4], state[5]
        for index in range(count):
            record[k, R_BENCH] += thrusters[index, ARM] * bench(commands[tick, index], thrusters[index])
        for j in range(6):
            state[j] += step / 6.0 * (slopes[0, j] + 2.0 * slopes[1, j] + 2.0 * slopes[2, j] + slopes[3, j])
        if cause[SAG] > 0.0:
            sag += step / cause[SAG_TIME] * (load(spins[0, 2], thrusters) - sag)
        for index in range(count):
            spins[0, 0, index], spins[1, 0, index] = spins[0, 2, index], spins[1, 2, index]
