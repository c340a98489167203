"""The user's choices on the page: parsed from the page's JSON and stored in rovid.toml."""

import hashlib
import json
import math
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from rovid.core.errors import NAME_LENGTH, ConfigError
from rovid.preflight.log_survey import LogSurvey, UserOverrides, all_commands
from rovid.preflight.raw_columns import SignalGuess
from rovid.trial.cutting import Exclusion

_SIZES = ("mass", "length", "width")
# These lines mark a rovid.toml that the page wrote, and hold the choices.
_HINT = "# Written by `rovid open`, which takes it up again as long as nobody changes it by hand:"
_SEAL = "# chosen = "


@dataclass(frozen=True, kw_only=True)
class FormState:
    """The choices that the page sends."""

    logs: tuple[str, ...]  # Names of files or folders below the root folder
    vehicle: str  # Type of vehicle; empty if none was chosen
    signals: Mapping[str, Mapping[str, SignalGuess]] | None  # Format -> signal -> column; None: as guessed
    overrides: UserOverrides
    document: Mapping[str, Any]  # The JSON document of the page
    planar: bool = False  # Surge, sway and yaw together instead of yaw alone

    def changes(self, guessed: LogSurvey) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Chosen heading columns that differ from the guess, and all command columns if any of them differs."""
        headings: list[str] = []
        for kind, signals in (self.signals or {}).items():
            if kind not in guessed.mappings:
                continue
            guess, chosen = guessed.mappings[kind].signals.get("heading"), signals.get("heading")
            if chosen is not None and (guess is None or guess.source != chosen.source):
                headings.append(chosen.source)
        commands = self.overrides.commands or frozenset()
        known = {command.source for command in all_commands(guessed.mappings)}
        return tuple(headings), () if commands <= known else tuple(sorted(commands))


def parse_form(document: object) -> FormState:
    """Check and convert the JSON document of the page. Raises ConfigError if the document has another form."""
    try:
        if not isinstance(document, dict):
            raise TypeError("no object")
        commands, signals = document.get("commands"), document.get("signals")
        sizes = {key: value for key, value in document.get("size", {}).items() if key in _SIZES and value is not None}
        every = [command for group in (commands or {}).values() for command in group]
        overrides = UserOverrides(
            name=_text(document.get("name", "")),
            size={key: _number(sizes[key], least=1e-6) for key in _SIZES if key in sizes},
            signals=None if signals is None else {kind: _signals(group) for kind, group in signals.items()},
            commands=None if commands is None else frozenset(_text(command["source"]) for command in every),
            arms={_text(one["source"]): _number(one["arm"]) for one in every if one.get("arm") is not None},
            directions={
                _text(one["source"]): math.radians(_number(one["angle"]))
                for one in every
                if one.get("angle") is not None
            },
            names={_text(one["source"]): _text(one["name"]) for one in every if one.get("name")},
            exclusions=tuple(map(_exclusion, document.get("leave_out", []))),
        )
        return FormState(
            logs=tuple(map(str, document["logs"])),
            vehicle=_vehicle(document.get("vehicle", "")),
            signals=overrides.signals,
            overrides=overrides,
            document=document,
            planar=document.get("axes") == "planar",
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(f"the page sent an invalid choice ({error}).", mend="Load the page again.") from error


def _vehicle(name: object) -> str:
    # A preset file of the user is for the command line only: the page reads nothing outside of its folder.
    if not isinstance(name, str) or name.endswith(".toml"):
        raise ValueError("vehicle")
    return name


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
        signals[_text(name)] = SignalGuess(source=_text(one["source"]), unit=unit, sign=sign, reason="")
    return signals


def _exclusion(one: Mapping[str, Any]) -> Exclusion:
    end = one.get("to")
    return Exclusion(
        log=_text(one["log"]),
        begin=_number(one.get("from") or 0.0),
        end=math.inf if end is None else _number(end),
        reason=_text(one.get("reason", "")),
    )


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
    for one in filter(_is_table, thrusters if isinstance(thrusters, list) else []):
        for kind in _sources(one.get("command"), kinds):
            shown = {"source": one["command"][kind], "name": str(one.get("name", "")), "arm": one.get("yaw_arm")}
            commands.setdefault(kind, []).append(shown)
    vehicle = _tables(config).get("vehicle", {})
    sizes = {key: vehicle[key] for key in _SIZES if isinstance(vehicle.get(key), int | float)}
    return {"signals": signals, "commands": commands, "size": sizes, "name": str(vehicle.get("name", ""))}


def _is_table(value: object) -> bool:
    return isinstance(value, dict)


def _tables(value: object) -> dict[str, dict[str, Any]]:
    return {key: one for key, one in value.items() if _is_table(one)} if isinstance(value, dict) else {}


def _sources(one: object, kinds: Collection[str]) -> list[str]:
    """Formats for which a table of rovid.toml names a source."""
    return [kind for kind in kinds if isinstance(one, dict) and isinstance(one.get(kind), str)]


def sha256_digest(data: bytes) -> str:
    """SHA-256 digest of ``data``."""
    return hashlib.sha256(data).hexdigest()
