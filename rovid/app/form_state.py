"""What was chosen on the page, as it comes from there and as it is kept in rovid.toml."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rovid.core.errors import NAME_LENGTH, ConfigError
from rovid.preflight.log_survey import LogSurvey, all_commands
from rovid.preflight.raw_columns import SignalGuess
from rovid.preflight.user_overrides import UserOverrides
from rovid.trial.trial import Exclusion

_SIZES = ("mass", "length", "width")
# By these lines a file of ours is known again, and what was chosen is read back.
_HINT = "# Written by `rovid open`, which takes it up again as long as nobody changes it by hand:"
_SEAL = "# chosen = "


@dataclass(frozen=True, kw_only=True)
class FormState:
    """What the page sends.

    Attributes
    ----------
    logs
        Names of files or folders below the top.
    vehicle
        Type of vehicle; empty where none was chosen.
    signals
        Format -> name -> what it is taken from; None as long as all is as guessed.
    document
        All of it as it came.
    """

    logs: tuple[str, ...]
    vehicle: str
    signals: Mapping[str, Mapping[str, SignalGuess]] | None
    hand: UserOverrides
    document: Mapping[str, Any]

    def differs(self, guessed: LogSurvey) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Headings, and commands, that are not among those ``guessed``; nothing where all are."""
        headings: list[str] = []
        for kind, signals in (self.signals or {}).items():
            own = guessed.mappings[kind].signals.get("heading") if kind in guessed.mappings else None
            chosen = signals.get("heading")
            if chosen is not None and (own is None or own.source != chosen.source):
                headings.append(chosen.source)
        wanted = self.hand.commands or frozenset()
        known = {command.source for command in all_commands(guessed.mappings)}
        return tuple(headings), () if wanted <= known else tuple(sorted(wanted))


def parse_form(document: object) -> FormState:
    """What the page sent, checked.

    Raises
    ------
    ConfigError
        It is not what the page sends.
    """
    try:
        if not isinstance(document, dict):
            raise TypeError("no object")
        commands = document.get("commands")
        signals = document.get("signals")
        every = [one for those in (commands or {}).values() for one in those]
        hand = UserOverrides(
            name=_text(document.get("name", "")),
            size={key: _number(document["size"][key], least=1e-6) for key in _SIZES if _given(document, key)},
            signals=None if signals is None else {kind: _signals(those) for kind, those in signals.items()},
            commands=None if commands is None else frozenset(_text(one["source"]) for one in every),
            arms={_text(one["source"]): _number(one["arm"]) for one in every if one.get("arm") is not None},
            names={_text(one["source"]): _text(one["name"]) for one in every if one.get("name")},
            exclusions=tuple(map(_stretch, document.get("leave_out", []))),
        )
        return FormState(
            logs=tuple(map(str, document["logs"])),
            vehicle=_vehicle(document.get("vehicle", "")),
            signals=hand.signals,
            hand=hand,
            document=document,
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(f"the page sent what is no choice ({error}).", mend="Load the page again.") from error


def _given(document: Mapping[str, Any], key: str) -> bool:
    return document.get("size", {}).get(key) is not None


def _vehicle(name: object) -> str:
    # A file of the user's own is for the command line: the page reads nothing outside its folder.
    if not isinstance(name, str) or name.endswith(".toml"):
        raise ValueError("vehicle")
    return name


def _text(value: object) -> str:
    if not isinstance(value, str) or len(value) > 10 * NAME_LENGTH:
        raise TypeError("a text was expected")
    return value


def _number(value: object, least: float = -math.inf) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < least:
        raise ValueError(f"{value!r} is no number that can be")
    return float(value)


def _signals(those: Mapping[str, Any]) -> dict[str, SignalGuess]:
    return {
        _text(name): SignalGuess(
            source=_text(one["source"]),
            unit=_text(one.get("unit") or ""),
            sign=-1 if one.get("sign", 1) < 0 else 1,
            reason="",
        )
        for name, one in those.items()
    }


def _stretch(one: Mapping[str, Any]) -> Exclusion:
    end = one.get("to")
    return Exclusion(
        log=_text(one["log"]),
        begin=_number(one.get("from") or 0.0),
        end=math.inf if end is None else _number(end),
        reason=_text(one.get("reason", "")),
    )


def with_form_data(text: str, choice: FormState, beside: Mapping[str, bytes]) -> str:
    """The ``text`` of rovid.toml with what was chosen, and by what it and the files ``beside`` it are known again."""
    own = {key: value for key, value in choice.document.items() if key != "logs"}
    kept = {"sha256": {"": _digest(text.encode()), **{n: _digest(data) for n, data in beside.items()}}, "choice": own}
    return f"{text}\n{_HINT}\n{_SEAL}{json.dumps(kept)}\n"


def read_form_data(text: str) -> tuple[Mapping[str, Any], Mapping[str, str]] | None:
    """What was chosen and the digests beside it, where nobody changed the file since; None of any other file."""
    body, hint, seal = text.partition(f"\n{_HINT}\n{_SEAL}")
    try:
        kept = json.loads(seal) if hint else {}
        whole = kept["sha256"][""] == _digest(body.encode())
        return (kept["choice"], kept["sha256"]) if whole else None
    except (KeyError, TypeError, ValueError):
        return None


def matches_digest(data: bytes, digest: str | None) -> bool:
    """Whether ``data`` is what was written."""
    return _digest(data) == digest


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
