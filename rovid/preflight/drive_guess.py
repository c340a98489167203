"""Guess a rudder or steered wheels, and the speed, from names, values and the response of the vehicle."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import lagged
from rovid.preflight.command_effects import CommandEffect, command_effects
from rovid.preflight.raw_columns import (
    LIGHT,
    MIN_SAMPLES,
    RATE,
    SUPPLY,
    Columns,
    RawColumn,
    SignalGuess,
    SourceColumn,
    ending_unit,
    held_mean,
    is_thruster_command,
    mean_rates,
    named_unit,
    word_list,
)
from rovid.preflight.thruster_guess import GuessHints, neutral_values
from rovid.trial.axis import ANGLE_UNITS, ANGULAR_RATE_UNITS, HEADING_WORDS, SPEED_UNITS, name_words

ORDER = word_list("drive", "order")
_RUDDER = word_list("drive", "rudder")
_WHEELS = word_list("drive", "wheels")
_STEERING = _RUDDER | _WHEELS | word_list("drive", "angle")
RPM = word_list("thruster", "speed")
_OTHER = word_list("thruster", "other")
_NOT_STEERING = (_OTHER - {"pos", "position", "lat"}) | word_list("drive", "not_angle") | LIGHT | RATE | HEADING_WORDS
_AHEAD, _OVER_GROUND = word_list("axis", "surge"), word_list("axis", "over_ground")
_NOT_AHEAD = (
    (word_list("axis", "not_measured", "sway", "heave", "direction") - ORDER - RPM)
    | {"gyro", "rate", "wx", "wy", "wz"}
    | SUPPLY
    | _STEERING
    | HEADING_WORDS
)
# Symbols of the speed ahead; a supply voltage with such a name stays above this share of its largest value.
_SYMBOLS, _STANDSTILL = {"u", "v"}, 0.2
# Rank of a speed by its name.
_NAMED = 3
# Largest steering angle, deg, and the largest number that may be an angle in rad.
_LARGEST_DEG, _LARGEST_RAD = 95.0, 1.6
# s, lag within which the yaw rate follows steered wheels; hulls of 1 m or more respond to a rudder later. Decision, for
# names that belong to both.
_PROMPT = 0.5
# Minimum share of the variance of the rate that a drive explains, for its sign and its wheelbase.
MIN_R2 = 0.2
# Averaging windows of rates: number in a log, and bounds in s. The lags that are tried, in windows.
_WINDOWS, _WINDOW_LIMITS, _LAGS = 1000, (0.01, 0.5), (0.0, 0.25, 0.5, *(2.0**power for power in range(9)))
# Maximum number of columns that a question lists.
_MAX_CANDIDATES = 8
# Subdivisions of a window, for the lag.
_FINE = 4

Log = Mapping[str, RawColumn]


@dataclass(frozen=True, kw_only=True)
class RudderGuess:
    """A rudder, or the steered wheels of a vehicle."""

    name: str
    angle: SignalGuess
    speed: str  #: Signal of the speed.
    wheelbase: float | None = None  #: m, estimated from the logs; None for a rudder.
    given: float | None = None  #: Wheelbase in m, or coefficient of a rudder in N m s^2/(m^2 rad), by the user.
    direction_known: bool = True


@dataclass(frozen=True, kw_only=True)
class Response:
    """Best fit of the rate by a drive behind a lag of first order."""

    gain: float = 0.0  #: Change of the rate in SI per unit of the drive.
    lag: float = 0.0  #: s
    r2: float = 0.0  #: Share of the variance of the rate.


def respond(
    logs: Sequence[Log], motion: SignalGuess, drive: Callable[[Log], tuple[FloatArray, FloatArray] | None]
) -> Response:
    """Response of the rate of ``motion`` to ``drive``: (n,) times in s and (n,) values of a log."""
    windows: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for log in logs:
        held = drive(log) if motion.source in log else None
        if held is None:
            continue
        duration = float(np.ptp(log[motion.source].time)) if log[motion.source].time.size else 0.0
        edges, rate = mean_rates(motion, log[motion.source], float(np.clip(duration / _WINDOWS, *_WINDOW_LIMITS)))
        if len(rate) < MIN_SAMPLES:
            continue
        fine = np.interp(np.arange(_FINE * len(rate) + 1) / _FINE, np.arange(len(edges)), edges)
        windows.append((fine[:-1], held_mean(*held, fine), rate - rate.mean()))
    if not windows:
        return Response()
    target = np.concatenate([rate for _, _, rate in windows])
    step = float(np.median([_FINE * (time[1] - time[0]) for time, _, _ in windows]))
    best = Response()
    for lag in step * np.array(_LAGS):
        late = [lagged(time, held, float(lag)).reshape(-1, _FINE).mean(axis=1) for time, held, _ in windows]
        row = np.concatenate([values - values.mean() for values in late])
        power, total = float(row @ row), float(target @ target)
        if not (power > 0.0 and total > 0.0):
            continue
        gain = float(row @ target) / power
        r2 = gain * gain * power / total
        if r2 > best.r2:
            best = Response(gain=gain * ANGULAR_RATE_UNITS.get(motion.unit, 1.0), lag=float(lag), r2=r2)
    return best


# ---- steering


def guess_rudder(
    columns: Columns, logs: Sequence[Log], heading: SignalGuess, hints: GuessHints
) -> tuple[RudderGuess, SignalGuess] | None:
    """The rudder or the steered wheels, and the speed, by name and motion."""
    chosen = hints.commands
    angles = sorted((source for source in columns if _is_steering(columns[source], chosen)), key=_is_order)
    if not angles:
        return None
    source = angles[0]
    steered = [log for log in logs if source in log]
    ranks = {name: rank for name, column in columns.items() if (rank := _speed_rank(column))}
    # The velocities along surge and sway, as u_m_s and v_m_s; u alone may be a supply voltage.
    ahead, aside = ([name for name in columns if name in {*ranks, one} and one in name_words(name)] for one in "uv")
    if ahead and aside:
        ranks = {name: rank for name, rank in ranks.items() if name not in aside} | dict.fromkeys(ahead, _NAMED)
    ranks = {name: rank for name, rank in ranks.items() if name in chosen} or _given_speed(columns, chosen) or ranks
    common = [name for name in ranks if all(name in log for log in steered)]
    speeds = sorted(common or ranks, key=lambda name: -ranks[name])
    if not speeds:
        return None
    name, speed = _speed_signal(speeds[0], columns)
    largest = float(np.max(np.abs(columns[source].values)))
    unit, origin = named_unit(source), "the unit by its name"
    if unit not in ANGLE_UNITS:
        unit, origin = ("deg", "more than a right angle in radians") if largest > _LARGEST_RAD else ("rad", "assumed")
    angle = SignalGuess(source=source, unit=unit, reason=f"by name; up to {largest:.4g}, {unit}: {origin}")
    others = {one: logged for one, logged in columns.items() if one not in {source, speed.source}}
    return _by_motion(logs, heading, angle, speed, name, neutral_values(others, hints)), speed


def speed_question(columns: Columns) -> str:
    """What the user has to name where an angle of a rudder or of wheels is logged and no speed is recognised."""
    angles = sorted((source for source in columns if _is_steering(columns[source], ())), key=_is_order)
    if not angles or any(map(_speed_rank, columns.values())):
        return ""
    others = [name for name, column in columns.items() if name not in angles and column.changes]
    candidates = ", ".join(others[:_MAX_CANDIDATES])
    return (
        f"{angles[0]} is the angle of a rudder or of wheels, by its name, and no column is a speed by its name. Name "
        f'both with --command "{angles[0]},SPEED"; SPEED may be one of {candidates or "no column here: log it"}.'
    )


def is_steered(source: str) -> bool:
    """Whether a column belongs to a rudder or to steered wheels by name, as an angle or an order."""
    return bool(name_words(source) & _STEERING)


def _given_speed(columns: Columns, chosen: Sequence[str]) -> dict[str, int]:
    """The one column that the user chose next to an angle, if it is no thruster by its name."""
    others = [name for name in chosen if name in columns and not name_words(name) & _STEERING]
    return {others[0]: 1} if len(others) == 1 and not is_thruster_command(others[0]) else {}


def _is_order(source: str) -> bool:
    return bool(name_words(source) & ORDER)


def _is_steering(column: SourceColumn, chosen: Sequence[str]) -> bool:
    words = column.words
    if not words & _STEERING or words & _NOT_STEERING or (chosen and column.source not in chosen):
        return False
    if words & _STEERING == {"delta"} and words - ORDER - {"delta", "deg", "rad", "angle", "data", "f"}:
        return False  # A difference of another quantity.
    return column.varies and float(np.max(np.abs(column.values))) <= _LARGEST_DEG


def _speed_rank(column: SourceColumn) -> int:
    """Rank of a column as the speed ahead by name; 0 for other quantities."""
    words, unit, values = column.words, column.unit, column.values
    if words & _NOT_AHEAD or (unit and unit not in SPEED_UNITS):
        return 0
    if not column.is_long or not np.any(values):
        return 0
    named = words & (_AHEAD | _OVER_GROUND | {"vel", "velocity"}) or unit
    rank = 0
    if words & RPM:
        rank = 1
    elif named:
        rank = _NAMED + 2 * bool(words & _AHEAD)
    elif words and words <= _SYMBOLS and values.min() < _STANDSTILL * values.max():
        rank = _NAMED
    return rank - bool(rank > 1 and words & ORDER)


def _speed_signal(source: str, columns: Columns) -> tuple[str, SignalGuess]:
    """Name in rovid.toml of a speed among ``columns``, and the guess."""
    words, unit = name_words(source), ending_unit(source)
    if words & RPM:
        return "propeller_speed", SignalGuess(source=source, reason="by name; the flow at a rudder behind a propeller")
    if source == "u" and "v" in columns:
        return "surge_velocity", SignalGuess(source=source, unit="m/s", reason="by name, next to v; m/s assumed")
    if words & ORDER or (words <= _SYMBOLS and not unit):
        return "ordered_speed", SignalGuess(source=source, reason="by name: a speed, measured or ordered; m/s assumed")
    reason = "by name; the unit by its name" if unit else "by name; m/s assumed"
    return "surge_velocity", SignalGuess(source=source, unit=unit or "m/s", reason=reason)


def _by_motion(
    logs: Sequence[Log],
    heading: SignalGuess,
    angle: SignalGuess,
    speed: SignalGuess,
    name: str,
    neutral: Mapping[str, float],
) -> RudderGuess:
    """A rudder or steered wheels with the sign by which the heading responds, with thrusters by ``neutral``."""

    def drive(log: Log, *, wheels: bool) -> tuple[FloatArray, FloatArray] | None:
        if angle.source not in log or speed.source not in log:
            return None
        steered, flow = known_samples(log[angle.source]), known_samples(log[speed.source])
        if not steered.time.size or not flow.time.size:
            return None
        delta = steered.values * ANGLE_UNITS[angle.unit]
        ahead = np.interp(steered.time, flow.time, flow.values) * SPEED_UNITS.get(speed.unit, 1.0)
        return steered.time, ahead * np.tan(delta) if wheels else ahead * np.abs(ahead) * delta

    response = respond(logs, heading, lambda log: drive(log, wheels=True))
    words = name_words(angle.source)
    # A name of both, as "delta", or of wheels, which outboard motors share.
    wheels = not words & _RUDDER and (response.r2 < MIN_R2 or response.lag <= _PROMPT)
    pushed = [
        {**log, "": RawColumn(source="", time=held[0], values=held[1])}
        for log in logs
        if heading.source in log and (held := drive(log, wheels=wheels)) is not None
    ]
    effect = command_effects({"": 0.0, **neutral}, pushed, heading)[""] if pushed else CommandEffect()
    direction, evidence = effect.direction, effect.text
    if wheels and not direction and response.r2 >= MIN_R2:
        direction, evidence = int(np.sign(response.gain)), f"{100.0 * response.r2:.0f} % of the variance of the rate"
    turns = f"it turns the heading {'up' if direction > 0 else 'down'} ({evidence})"
    if not direction:
        turns = "these logs do not show which way it turns the vehicle"
    kind = "a rudder"
    if wheels:
        late = f"within {response.lag:.2g} s" if response.lag else "at once"
        follows = response.r2 >= MIN_R2
        kind = f"steered wheels: the yaw rate follows it {late}" if follows else "steered wheels by its name"
    wheelbase = None
    if wheels:
        wheelbase = float(f"{1.0 / abs(response.gain):.2g}") if response.r2 >= MIN_R2 else 1.0
    return RudderGuess(
        name="steering" if wheels else "rudder",
        angle=replace(angle, sign=direction or 1, reason=f"{angle.reason}; {kind}; {turns}"),
        speed=name,
        wheelbase=wheelbase,
        direction_known=bool(direction),
    )


def known_samples(column: RawColumn) -> RawColumn:
    """The finite samples of a column."""
    known = np.isfinite(column.values)
    return replace(column, time=column.time[known], values=column.values[known])
