"""Guess a rudder or steered wheels with the speed, a motor on a bench, and a yaw rate without a heading.

The guesses rest on names, values and the response of the vehicle.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
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
    Log,
    RawColumn,
    SignalGuess,
    SourceColumn,
    ending_unit,
    held_mean,
    is_thruster_command,
    is_yaw_rate,
    mean_rates,
    named_unit,
    word_list,
)
from rovid.preflight.thruster_guess import GuessHints, ThrusterCommand, neutral_values
from rovid.trial.axis import ANGLE_UNITS, ANGULAR_RATE_UNITS, HEADING_WORDS, SPEED_UNITS, name_words

_ORDER = word_list("drive", "order")
_RUDDER = word_list("drive", "rudder")
_WHEELS = word_list("drive", "wheels")
STEERING = _RUDDER | _WHEELS | word_list("drive", "angle")
_RPM = word_list("thruster", "speed")
_OTHER = word_list("thruster", "other") - {"pos", "position", "lat"}
_NOT_STEERING = _OTHER | word_list("drive", "not_angle") | LIGHT | RATE | HEADING_WORDS
_AHEAD, _OVER_GROUND = word_list("axis", "surge"), word_list("axis", "over_ground")
_NOT_AHEAD = (word_list("axis", "not_measured", "sway", "heave", "direction") - _ORDER - _RPM) | (
    {"gyro", "rate", "wx", "wy", "wz"} | SUPPLY | STEERING | HEADING_WORDS
)
_CURRENT, _SHAFT, _VEHICLE = (word_list("drive", name) for name in ("current", "shaft", "vehicle"))
# rad/s, limit of a yaw rate without a unit: two turns a second; decision.
_FASTEST = 4.0 * np.pi
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
_MIN_R2 = 0.2
# Averaging windows of rates: number in a log, and bounds in s. The lags that are tried, in windows.
_WINDOWS, _WINDOW_LIMITS, _LAGS = 1000, (0.01, 0.5), (0.0, 0.25, 0.5, *(2.0**power for power in range(9)))
# Maximum number of columns that a question lists.
_MAX_CANDIDATES = 8
# Subdivisions of a window, for the lag.
_FINE = 4


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
class _Response:
    """Best fit of the rate by a drive behind a lag of first order."""

    gain: float = 0.0  #: Change of the rate in SI per unit of the drive.
    lag: float = 0.0  #: s
    r2: float = 0.0  #: Share of the variance of the rate.


def _respond(
    logs: Sequence[Log], motion: SignalGuess, drive: Callable[[Log], tuple[FloatArray, FloatArray] | None]
) -> _Response:
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
        return _Response()
    target = np.concatenate([rate for _, _, rate in windows])
    step = float(np.median([_FINE * (time[1] - time[0]) for time, _, _ in windows]))
    best = _Response()
    for lag in step * np.array(_LAGS):
        late = [lagged(time, held, float(lag)).reshape(-1, _FINE).mean(axis=1) for time, held, _ in windows]
        row = np.concatenate([values - values.mean() for values in late])
        power, total = float(row @ row), float(target @ target)
        if not (power > 0.0 and total > 0.0):
            continue
        gain = float(row @ target) / power
        r2 = gain * gain * power / total
        if r2 > best.r2:
            best = _Response(gain=gain * ANGULAR_RATE_UNITS.get(motion.unit, 1.0), lag=float(lag), r2=r2)
    return best


# ---- steering


def guess_rudder(
    columns: Columns, logs: Sequence[Log], heading: SignalGuess, hints: GuessHints
) -> tuple[RudderGuess, SignalGuess] | None:
    """The rudder or the steered wheels, and the speed, by name and motion."""
    chosen = hints.commands
    angles = _steering_angles(columns, chosen)
    if not angles:
        return None
    source = angles[0]
    steered = [log for log in logs if source in log]
    ranks = {name: rank for name, column in columns.items() if (rank := _speed_rank(column))}
    # The velocities along surge and sway, as u_m_s and v_m_s; u alone may be a supply voltage.
    ahead, aside = ([name for name in columns if name in {*ranks, one} and one in name_words(name)] for one in "uv")
    if ahead and aside:
        ranks = {name: rank for name, rank in ranks.items() if name not in aside} | dict.fromkeys(ahead, _NAMED)
    # Else the one column that the user chose next to an angle, if it is no thruster by its name.
    others = [name for name in chosen if name in columns and not name_words(name) & STEERING]
    given = {others[0]: 1} if len(others) == 1 and not is_thruster_command(others[0]) else {}
    ranks = {name: rank for name, rank in ranks.items() if name in chosen} or given or ranks
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
    free = {one: logged for one, logged in columns.items() if one not in {source, speed.source}}
    return _by_motion(logs, heading, angle, speed, name, neutral_values(free, hints)), speed


def speed_question(columns: Columns) -> str:
    """What the user has to name where an angle of a rudder or of wheels is logged and no speed is recognised."""
    angles = _steering_angles(columns)
    if not angles or any(map(_speed_rank, columns.values())):
        return ""
    others = [name for name, column in columns.items() if name not in angles and column.changes]
    candidates = ", ".join(others[:_MAX_CANDIDATES])
    return (
        f"{angles[0]} is the angle of a rudder or of wheels, by its name, and no column is a speed by its name. Name "
        f'both with --command "{angles[0]},SPEED"; SPEED may be one of {candidates or "no column here: log it"}.'
    )


def _steering_angles(columns: Columns, chosen: Sequence[str] = ()) -> list[str]:
    """Sources of steering angles by name, orders last; those ``chosen`` if any are."""
    found = []
    for source, column in columns.items():
        words = column.words
        if not words & STEERING or words & _NOT_STEERING or (chosen and source not in chosen):
            continue
        if words & STEERING == {"delta"} and words - _ORDER - {"delta", "deg", "rad", "angle", "data", "f"}:
            continue  # A difference of another quantity.
        if column.varies and float(np.max(np.abs(column.values))) <= _LARGEST_DEG:
            found.append(source)
    return sorted(found, key=lambda source: bool(name_words(source) & _ORDER))


def _speed_rank(column: SourceColumn) -> int:
    """Rank of a column as the speed ahead by name; 0 for other quantities."""
    words, unit, values = column.words, column.unit, column.values
    if words & _NOT_AHEAD or (unit and unit not in SPEED_UNITS):
        return 0
    if not column.is_long or not np.any(values):
        return 0
    named = words & (_AHEAD | _OVER_GROUND | {"vel", "velocity"}) or unit
    rank = 0
    if words & _RPM:
        rank = 1
    elif named:
        rank = _NAMED + 2 * bool(words & _AHEAD)
    elif words and words <= _SYMBOLS and values.min() < _STANDSTILL * values.max():
        rank = _NAMED
    return rank - bool(rank > 1 and words & _ORDER)


def _speed_signal(source: str, columns: Columns) -> tuple[str, SignalGuess]:
    """Name in rovid.toml of a speed among ``columns``, and the guess."""
    words, unit = name_words(source), ending_unit(source)
    if words & _RPM:
        return "propeller_speed", SignalGuess(source=source, reason="by name; the flow at a rudder behind a propeller")
    if source == "u" and "v" in columns:
        return "surge_velocity", SignalGuess(source=source, unit="m/s", reason="by name, next to v; m/s assumed")
    if words & _ORDER or (words <= _SYMBOLS and not unit):
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
        steered, flow = _known_samples(log[angle.source]), _known_samples(log[speed.source])
        if not steered.time.size or not flow.time.size:
            return None
        delta = steered.values * ANGLE_UNITS[angle.unit]
        ahead = np.interp(steered.time, flow.time, flow.values) * SPEED_UNITS.get(speed.unit, 1.0)
        return steered.time, ahead * np.tan(delta) if wheels else ahead * np.abs(ahead) * delta

    response = _respond(logs, heading, lambda log: drive(log, wheels=True))
    words = name_words(angle.source)
    # A name of both, as "delta", or of wheels, which outboard motors share.
    wheels = not words & _RUDDER and (response.r2 < _MIN_R2 or response.lag <= _PROMPT)
    pushed = [
        {**log, "": RawColumn(source="", time=held[0], values=held[1])}
        for log in logs
        if heading.source in log and (held := drive(log, wheels=wheels)) is not None
    ]
    effect = command_effects({"": 0.0, **neutral}, pushed, heading)[""] if pushed else CommandEffect()
    direction, evidence = effect.direction, effect.text
    if wheels and not direction and response.r2 >= _MIN_R2:
        direction, evidence = int(np.sign(response.gain)), f"{100.0 * response.r2:.0f} % of the variance of the rate"
    turns = f"it turns the heading {'up' if direction > 0 else 'down'} ({evidence})"
    if not direction:
        turns = "these logs do not show which way it turns the vehicle"
    kind = "a rudder"
    wheelbase: float | None = None
    if wheels and response.r2 >= _MIN_R2:
        late = f"within {response.lag:.2g} s" if response.lag else "at once"
        kind, wheelbase = f"steered wheels: the yaw rate follows it {late}", float(f"{1.0 / abs(response.gain):.2g}")
    elif wheels:
        kind, wheelbase = "steered wheels by its name", 1.0
    return RudderGuess(
        name="steering" if wheels else "rudder",
        angle=replace(angle, sign=direction or 1, reason=f"{angle.reason}; {kind}; {turns}"),
        speed=name,
        wheelbase=wheelbase,
        direction_known=bool(direction),
    )


def _known_samples(column: RawColumn) -> RawColumn:
    """The finite samples of a column."""
    known = np.isfinite(column.values)
    return replace(column, time=column.time[known], values=column.values[known])


# ---- a rate without a heading


def lone_yaw_rate(columns: Columns, chosen: str) -> SignalGuess | None:
    """A yaw rate by name, or ``chosen`` by the user, where no heading is logged; its unit by name or values."""
    for source in [chosen] if chosen in columns else filter(is_yaw_rate, columns):
        column = columns[source]
        if not column.varies:
            continue
        unit = column.unit if column.unit in ANGULAR_RATE_UNITS else ""
        reason = f"{'chosen by you' if chosen else 'by name'}; {column.span}; no heading is logged"
        if not unit:
            # rad/s, faster than vehicles turn.
            unit = "deg/s" if float(np.max(np.abs(column.values))) > _FASTEST else "rad/s"
            reason += f"; assumed to be in {unit}"
        return SignalGuess(source=source, unit=unit, reason=reason, is_rate=True)
    return None


def guess_shaft(
    columns: Columns, logs: Sequence[Log], chosen: str, commands: Sequence[str]
) -> tuple[dict[str, SignalGuess], tuple[ThrusterCommand, ...], tuple[str, ...]] | None:
    """A motor whose own speed is the motion, by names; the user may have ``chosen`` the speed and ``commands``.

    The rate with the order to its controller, the command without an order, and remarks on other motors and on a
    current next to an order.
    """
    if not chosen and any(name_words(source) & _VEHICLE for source in columns):
        return None
    speeds = []
    for source, column in columns.items():
        words = column.words
        is_speed = bool(words & (_SHAFT | _RPM)) and not words & (_ORDER | LIGHT | {"error", "err"})
        if (source == chosen if chosen else is_speed) and rate_unit(source) and column.changes:
            speeds.append(source)
    if not speeds:
        return None
    speed = speeds[0]
    free = {source: logged for source, logged in columns.items() if source not in speeds}
    if commands:
        free = {source: free[source] for source in commands if source in free}
    motion = SignalGuess(source=speed, unit=rate_unit(speed), reason="", is_rate=True)
    orders, currents, others = ([*_same_motor(speed, kind, free, commands)] for kind in _KINDS)
    drives = orders or currents or others
    if not drives:
        return None
    drive = drives[0]

    def held(log: Log) -> tuple[FloatArray, FloatArray] | None:
        known = _known_samples(log[drive]) if drive in log else None
        return (known.time, known.values) if known is not None and known.time.size else None

    response = _respond(logs, motion, held)
    direction = int(np.sign(response.gain)) if response.r2 >= _MIN_R2 else 0
    origin = "chosen by you" if chosen else "by name, and no column is a heading"
    rate = replace(motion, reason=f"{origin}: the speed of a shaft on a bench; {motion.unit} by its name")
    remarks = []
    is_kind = next((one for one in _KINDS if one(drive)), _is_duty)
    for further in speeds[1:]:
        if other := next(_same_motor(further, is_kind, columns, ()), ""):
            text = f'{further} is another shaft, not used: --heading "{further}" --command "{other}" takes it.'
            remarks.append(text)
    if not orders:
        column, turns = columns[drive], "these logs do not show which way it turns the shaft"
        if direction:
            turns = f"more of it turns the shaft {'up' if direction > 0 else 'down'} (R2 {response.r2:.2f})"
        command = ThrusterCommand(
            name="motor",
            source=drive,
            direction=direction,
            neutral=0.0,
            lowest=float(column.values.min()),
            highest=float(column.values.max()),
            reason=f"by name; {column.span}; {turns}",
            direction_known=bool(direction),
            is_motor=True,
        )
        return {"yaw_rate": rate}, (command,), tuple(remarks)
    if currents or others:
        other = (currents or others)[0]
        option = f'--heading "{speed}" --command "{other}"'
        remarks.insert(0, f"{drive} is an order to a controller: no inertia follows from it. {option} takes {other}.")
    reason = f"by name: the order to a controller; the speed follows it (R2 {response.r2:.2f})"
    order = SignalGuess(source=drive, unit=rate_unit(drive) or motion.unit, sign=direction or 1, reason=reason)
    return {"yaw_rate": rate, "yaw_rate_order": order}, (), tuple(remarks)


def rate_unit(source: str) -> str:
    """Unit of an angular rate by the name; empty without one."""
    unit = ending_unit(source) or named_unit(source)
    if unit in ANGULAR_RATE_UNITS:
        return unit
    return "rpm" if name_words(source) & _RPM else ""


def _is_rate_order(source: str) -> bool:
    words = name_words(source)
    return bool(words & _ORDER) and bool(rate_unit(source) or words & (_SHAFT - {"motor", "motors", "moteur"}))


def _is_current(source: str) -> bool:
    words = name_words(source)
    return bool(words & _CURRENT) and not words & (_ORDER | SUPPLY | LIGHT)


def _is_duty(source: str) -> bool:
    return is_thruster_command(source) or name_words(source) in ({"u"}, {"v"}, {"voltage"})


# Kinds of drives, best known first: an order hides the torque, a current is proportional to it.
_KINDS = (_is_rate_order, _is_current, _is_duty)


def _same_motor(speed: str, is_kind: Callable[[str], bool], free: Columns, commands: Sequence[str]) -> Iterator[str]:
    """Varying columns of one kind, that of the same motor first: it shares the most words with the name ``speed``."""
    words = name_words(speed)
    found = [source for source in free if is_kind(source)]
    if commands and is_kind is _is_duty:
        found = list(free)
    for source in sorted(found, key=lambda source: -len(words & name_words(source))):
        if free[source].changes:
            yield source
