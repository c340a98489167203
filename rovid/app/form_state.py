"""Columns and choices of the page: decimated columns for plots; choices from the page's JSON, stored in rovid.toml."""

import hashlib
import json
import math
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import NAME_LENGTH, ConfigError
from rovid.preflight.log_survey import LogSurvey, UserOverrides, all_commands
from rovid.preflight.raw_columns import RawColumn, SignalGuess
from rovid.trial.axis import TIME_UNITS, meant_signal
from rovid.trial.preprocessing import Exclusion


def columns_document(
    columns: Mapping[str, RawColumn],
    needed: Sequence[str],
    begin: float,
    end: float,
    bins: int,
    turns: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """All columns between ``begin`` and ``end``, in s from the origin of the times in [[leave_out]].

    ``needed``: Sources of the heading (first) and of the commands: the log begins when all of them are known.
    ``bins``: Number of time bins.
    ``turns``: Source of an angle -> a full turn in its unit; it is shown without jumps of whole turns.
    """
    turns = turns or {}
    origin = _time_origin(columns, needed)
    times = [column.time for column in columns.values() if len(column.time)]
    first = min((float(time.min()) for time in times), default=0.0) - origin
    last = max((float(time.max()) for time in times), default=0.0) - origin
    low, high = max(begin, first), min(end, last)
    shown = []
    for source, column in columns.items():
        document = _decimate(column.time - origin, column.values, low, high, bins, turns.get(source))
        shown.append({"source": source, **document})
    return {"begin": first, "end": last, "columns": shown}


def _time_origin(columns: Mapping[str, RawColumn], needed: Sequence[str]) -> float:
    known = [column.time[np.isfinite(column.values)] for source, column in columns.items() if source in needed]
    starts = [float(time.min()) for time in known if time.size]
    if not starts:
        return min((float(column.time.min()) for column in columns.values() if len(column.time)), default=0.0)
    heading = columns.get(needed[0])
    if heading is None:
        return max(starts)
    measured = heading.time[np.isfinite(heading.values)]
    after = measured[measured >= max(starts)]
    return float(after.min()) if after.size else max(starts)


def _decimate(
    time: FloatArray, values: FloatArray, begin: float, end: float, bins: int, turn: float | None
) -> dict[str, Any]:
    """Number and range of all values; times, minima and maxima of the bins in view."""
    known = np.isfinite(values)
    order = np.argsort(time[known], kind="stable")
    time, values = time[known][order], values[known][order]
    document: dict[str, Any] = {"samples": len(values), "lowest": None, "highest": None}
    if len(values):
        document |= {"lowest": _rounded(values.min()), "highest": _rounded(values.max())}
    if turn is not None:
        values = np.unwrap(values, period=turn)
    # One more sample at each end lets the line leave the plot.
    first = max(int(np.searchsorted(time, begin)) - 1, 0)
    last = int(np.searchsorted(time, end, side="right")) + 1
    time, low, high = time[first:last], values[first:last], values[first:last]
    if len(time) > 2 * bins:
        starts = np.unique(np.searchsorted(time, np.linspace(time[0], time[-1], bins, endpoint=False)))
        low, high = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
        time = time[starts]
    document["time"] = [round(value, 4) for value in time.tolist()]  # s, to 0.1 ms
    return document | {"low": list(map(_rounded, low.tolist())), "high": list(map(_rounded, high.tolist()))}


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")


_SIZES = ("mass", "length", "width")
# These lines mark a rovid.toml that the page wrote, and hold the choices.
_HINT = "# Written by `rovid open`, which takes it up again as long as nobody changes it by hand:"
_SEAL = "# chosen = "


@dataclass(frozen=True, kw_only=True)
class FormState:
    """The choices that the page sends."""

    logs: tuple[str, ...]  # Names of files or folders below the root folder
    vehicle: str  # Type of vehicle; empty if none was chosen
    overrides: UserOverrides
    document: Mapping[str, Any]  # The JSON document of the page
    time_unit: str = "auto"
    planar: bool = False  # Surge, sway and yaw together instead of yaw alone

    def changes(self, guessed: LogSurvey) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Chosen heading columns that differ from the guess, and all command columns if any of them differs."""
        headings: list[str] = []
        for kind, signals in (self.overrides.signals or {}).items():
            if kind not in guessed.mappings:
                continue
            guess, chosen = guessed.mappings[kind].signals.get("heading"), signals.get("heading")
            if chosen is not None and (guess is None or guess.source != chosen.source):
                headings.append(chosen.source)
        commands = self.overrides.commands or frozenset()
        known = {*guessed.left_out.commands, *(command.source for command in all_commands(guessed.mappings))}
        return tuple(headings), () if commands <= known else tuple(sorted(commands))


def parse_form(document: object) -> FormState:
    """Check and convert the JSON document of the page. Raises ConfigError if the document has another form."""
    try:
        if not isinstance(document, dict):
            raise TypeError("no object")
        commands, signals = document.get("commands"), document.get("signals")
        sizes = {key: value for key, value in document.get("size", {}).items() if key in _SIZES and value is not None}
        every = [command for group in (commands or {}).values() for command in group]
        arms, directions, names, exclusions = {}, {}, {}, []
        for one in every:
            source = _text(one["source"])
            if one.get("arm") is not None:
                arms[source] = _number(one["arm"])
            if one.get("angle") is not None:
                directions[source] = math.radians(_number(one["angle"]))
            if one.get("name"):
                names[source] = _text(one["name"])
        for one in document.get("leave_out", []):
            log, reason, end = _text(one["log"]), _text(one.get("reason", "")), one.get("to")
            begin, end = _number(one.get("from") or 0.0), math.inf if end is None else _number(end)
            exclusions.append(Exclusion(log=log, begin=begin, end=end, reason=reason))
        overrides = UserOverrides(
            name=_text(document.get("name", "")),
            size={key: _number(sizes[key], least=1e-6) for key in _SIZES if key in sizes},
            signals=None if signals is None else {kind: _signals(group) for kind, group in signals.items()},
            commands=None if commands is None else frozenset(_text(command["source"]) for command in every),
            arms=arms,
            directions=directions,
            names=names,
            rudders={_text(name): _number(one, least=1e-9) for name, one in document.get("rudders", {}).items()},
            exclusions=tuple(exclusions),
        )
        vehicle, time_unit = document.get("vehicle", ""), document.get("time_unit", "auto")
        # A preset file of the user is for the command line only: the page reads nothing outside of its folder.
        if not isinstance(vehicle, str) or vehicle.endswith(".toml"):
            raise ValueError("vehicle")
        if time_unit not in TIME_UNITS:
            raise ValueError("time_unit")
        return FormState(
            logs=tuple(map(str, document["logs"])),
            vehicle=vehicle,
            overrides=overrides,
            document=document,
            time_unit=time_unit,
            planar=document.get("axes") == "planar",
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(f"the page sent an invalid choice ({error}).", mend="Load the page again.") from error


def _text(value: object) -> str:
    if not isinstance(value, str) or len(value) > 10 * NAME_LENGTH:
        raise TypeError("a text was expected")
    return value


def _number(value: object, least: float = -math.inf) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < least:
        raise ValueError(f"{value!r} is not a valid number")
    return float(value)


def _signals(group: Mapping[str, Any]) -> dict[str, SignalGuess]:
    signals = {}
    for name, one in group.items():
        sign = -1 if one.get("sign", 1) < 0 else 1
        unit = _text(one.get("unit") or "")
        # A further channel that is carried along must not look like a misspelt signal.
        own_name = f"{_text(name)}_column" if meant_signal(name) else _text(name)
        signals[own_name] = SignalGuess(source=_text(one["source"]), unit=unit, sign=sign, reason="")
    return signals


def with_form_data(text: str, form: FormState, curves: Mapping[str, bytes]) -> str:
    """The ``text`` of rovid.toml with the choices and the digests of the text and of the ``curves``, by file name."""
    choice = {key: value for key, value in form.document.items() if key != "logs"}
    digests = {"": sha256_digest(text.encode()), **{name: sha256_digest(data) for name, data in curves.items()}}
    return f"{text}\n{_HINT}\n{_SEAL}{json.dumps({'sha256': digests, 'choice': choice})}\n"


def read_form_data(text: str) -> tuple[Mapping[str, Any], Mapping[str, str]] | None:
    """Choices and digests in a rovid.toml that the page wrote; None for other and for changed files."""
    body, hint, seal = text.partition(f"\n{_HINT}\n{_SEAL}")
    try:
        data = json.loads(seal) if hint else {}
        if data["sha256"][""] == sha256_digest(body.encode()):
            return data["choice"], data["sha256"]
    except (KeyError, TypeError, ValueError):
        pass
    return None


def choices_of(text: str, kinds: Collection[str]) -> dict[str, Any]:
    """The choices of a user's own rovid.toml for logs of these formats, as far as the page shows them."""
    try:
        config = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return {}
    signals: dict[str, dict[str, Any]] = {}
    commands: dict[str, list[Any]] = {}
    for name, one in _tables(config.get("signals")).items():
        for kind in _sources(one, kinds) if name != "time" else ():
            shown = {"source": one[kind], "unit": one.get("unit", ""), "sign": one.get("sign", 1)}
            signals.setdefault(kind, {})[name] = shown
    thrusters = config.get("thrusters")
    for one in thrusters if isinstance(thrusters, list) else []:
        if not isinstance(one, dict):
            continue
        for kind in _sources(one.get("command"), kinds):
            shown = {"source": one["command"][kind], "name": str(one.get("name", "")), "arm": one.get("yaw_arm")}
            commands.setdefault(kind, []).append(shown)
    vehicle = _tables(config).get("vehicle", {})
    sizes = {key: vehicle[key] for key in _SIZES if isinstance(vehicle.get(key), int | float)}
    unit = _tables(config.get("signals")).get("time", {}).get("unit", "auto")
    name = str(vehicle.get("name", ""))
    return {"signals": signals, "commands": commands, "size": sizes, "name": name, "time_unit": unit}


def _tables(value: object) -> dict[str, dict[str, Any]]:
    return {key: one for key, one in value.items() if isinstance(one, dict)} if isinstance(value, dict) else {}


def _sources(one: object, kinds: Collection[str]) -> list[str]:
    return [kind for kind in kinds if isinstance(one, dict) and isinstance(one.get(kind), str)]


def sha256_digest(data: bytes) -> str:
    """SHA-256 digest of ``data``."""
    return hashlib.sha256(data).hexdigest()
