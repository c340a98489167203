"""Guess a motor on a bench or behind a controller, and a yaw rate without a heading."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.preflight.drive_guess import MIN_R2, ORDER, RPM, Log, Response, known_samples, respond
from rovid.preflight.raw_columns import (
    LIGHT,
    SUPPLY,
    Columns,
    SignalGuess,
    SourceColumn,
    ending_unit,
    is_thruster_command,
    is_yaw_rate,
    named_unit,
    word_list,
)
from rovid.preflight.thruster_guess import ThrusterCommand
from rovid.trial.axis import ANGULAR_RATE_UNITS, name_words

_CURRENT = word_list("drive", "current")
_SHAFT = word_list("drive", "shaft")
_VEHICLE = word_list("drive", "vehicle")
# rad/s, limit of a yaw rate without a unit: two turns a second; decision.
_FASTEST = 4.0 * np.pi


@dataclass(frozen=True, kw_only=True)
class ShaftGuess:
    """A motor whose own speed is the motion, without a vehicle."""

    signals: Mapping[str, SignalGuess]  #: The rate, and the order to its controller.
    commands: tuple[ThrusterCommand, ...]
    remarks: tuple[str, ...]  #: Other motors, and a current next to an order.


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


def guess_shaft(columns: Columns, logs: Sequence[Log], chosen: str, commands: Sequence[str]) -> ShaftGuess | None:
    """A motor and its own speed, by names; the user may have ``chosen`` the speed and ``commands``."""
    if not chosen and any(name_words(source) & _VEHICLE for source in columns):
        return None
    speeds = [source for source in columns if (source == chosen if chosen else _is_shaft_speed(source))]
    speeds = [source for source in speeds if rate_unit(source) and columns[source].changes]
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
    response = respond(logs, motion, lambda log: _held(log, drive))
    direction = int(np.sign(response.gain)) if response.r2 >= MIN_R2 else 0
    origin = "chosen by you" if chosen else "by name, and no column is a heading"
    rate = replace(motion, reason=f"{origin}: the speed of a shaft on a bench; {motion.unit} by its name")
    remarks = list(_other_motors(speeds, columns, orders[:1] or drives[:1]))
    if not orders:
        command = _motor_command(columns[drive], direction, response)
        return ShaftGuess(signals={"yaw_rate": rate}, commands=(command,), remarks=tuple(remarks))
    if currents or others:
        other = (currents or others)[0]
        option = f'--heading "{speed}" --command "{other}"'
        remarks.insert(0, f"{drive} is an order to a controller: no inertia follows from it. {option} takes {other}.")
    reason = f"by name: the order to a controller; the speed follows it (R2 {response.r2:.2f})"
    order = SignalGuess(source=drive, unit=rate_unit(drive) or motion.unit, sign=direction or 1, reason=reason)
    return ShaftGuess(signals={"yaw_rate": rate, "yaw_rate_order": order}, commands=(), remarks=tuple(remarks))


def rate_unit(source: str) -> str:
    """Unit of an angular rate by the name; empty without one."""
    unit = ending_unit(source) or named_unit(source)
    if unit in ANGULAR_RATE_UNITS:
        return unit
    return "rpm" if name_words(source) & RPM else ""


def _is_shaft_speed(source: str) -> bool:
    words = name_words(source)
    return bool(words & (_SHAFT | RPM)) and bool(rate_unit(source)) and not words & (ORDER | LIGHT | {"error", "err"})


def _is_rate_order(source: str) -> bool:
    words = name_words(source)
    return bool(words & ORDER) and bool(rate_unit(source) or words & (_SHAFT - {"motor", "motors", "moteur"}))


def _is_current(source: str) -> bool:
    words = name_words(source)
    return bool(words & _CURRENT) and not words & (ORDER | SUPPLY | LIGHT)


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


def _held(log: Log, source: str) -> tuple[FloatArray, FloatArray] | None:
    if source not in log:
        return None
    known = known_samples(log[source])
    return (known.time, known.values) if known.time.size else None


def _motor_command(column: SourceColumn, direction: int, response: Response) -> ThrusterCommand:
    turns = "these logs do not show which way it turns the shaft"
    if direction:
        turns = f"more of it turns the shaft {'up' if direction > 0 else 'down'} (R2 {response.r2:.2f})"
    return ThrusterCommand(
        name="motor",
        source=column.source,
        direction=direction,
        neutral=0.0,
        lowest=float(column.values.min()),
        highest=float(column.values.max()),
        reason=f"by name; {column.span}; {turns}",
        direction_known=bool(direction),
        is_motor=True,
    )


def _other_motors(speeds: Sequence[str], columns: Columns, drives: Sequence[str]) -> Iterator[str]:
    """How to choose another motor, for each further shaft."""
    is_kind = next((one for one in _KINDS if drives and one(drives[0])), _is_duty)
    for speed in speeds[1:]:
        drive = next(_same_motor(speed, is_kind, columns, ()), "")
        if drive:
            yield f'{speed} is another shaft, not used: --heading "{speed}" --command "{drive}" takes it.'
