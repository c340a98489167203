"""Checks of tables, blocks and values of a rovid.toml; each error names the place inside the file."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rovid.core.errors import NAME_LENGTH, ConfigError, suggestion
from rovid.core.input_files import expected_number
from rovid.trial.axis import DEFAULT_UNIT, PLANAR, SIGNAL_UNITS, TIME_UNITS, YAW, Axis, Signal
from rovid.trial.log_files import KINDS

# Suffix of the key that marks a value as a guess of `rovid init`: yaw_arm_guessed.
GUESSED = "_guessed"
# Signals that depend on the place where they are measured.
_PLACED_SIGNALS = ("surge_velocity", "sway_velocity", "north", "east")


class ConfigValues:
    """The file at ``path``, read along ``axis``; `PLANAR` stands for surge, sway and yaw together."""

    def __init__(self, path: Path, axis: Axis) -> None:
        self.path = path
        self.planar = axis is PLANAR
        self.axis = YAW if self.planar else axis

    def error(self, place: str, message: str, mend: str = "") -> ConfigError:
        """The error at this place of the file."""
        return ConfigError(message, where=f"{self.path}: {place}", mend=mend)

    def table(self, document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
        """The table of this name; empty where there is none."""
        value = document.get(name, {})
        if not isinstance(value, dict):
            raise self.error(name, f"is {value!r}; a table [{name}] was expected.")
        return value

    def blocks(self, document: Mapping[str, Any], name: str) -> list[Any]:
        """The blocks of this name."""
        value = document.get(name, [])
        if not isinstance(value, list):
            raise self.error(name, f"must be written [[{name}]], one block each.")
        return value

    def require_block(self, block: Any, name: str, place: str, keys: Sequence[str]) -> None:
        """Refuse all but a block with known ``keys``."""
        if not isinstance(block, dict):
            raise self.error(place, f"is {block!r}; a block [[{name}]] was expected.")
        self.require_known(block, keys, place)

    def require_known(self, table: Iterable[str], keys: Sequence[str], place: str) -> None:
        """Refuse unknown keys."""
        for key in table:
            if key not in keys:
                raise self.error(place, f"{key!r} is not known here.", suggestion(key, keys))

    def number(self, value: Any, place: str, *, positive: bool = False) -> float:
        """The value as a number."""
        expected = expected_number(value, positive=positive)
        if expected:
            raise self.error(place, f"is {value!r}; {expected} was expected.")
        return float(value)

    def name(self, value: Any, place: str) -> str:
        """The value as a name."""
        text = str(value)
        if len(text) > NAME_LENGTH:
            raise self.error(place, f"is a name of {len(text)} characters; {NAME_LENGTH} at most were expected.")
        return text

    def signal(self, name: str, value: Any, place: str, *, like: str = "") -> Signal:
        """The signal of this ``value``; in the units of the signal ``like`` if that is given."""
        entry = {"csv": value} if isinstance(value, str) else value
        if not isinstance(entry, dict) or not entry:
            raise self.error(place, f'is {value!r}; {{ csv = "<column>", mcap = "<topic.field>" }} was expected.')
        self.require_known(entry, (*KINDS, "unit", "sign", *["position"] * (name in _PLACED_SIGNALS)), place)
        position = self.place_of(entry, place) if "position" in entry else None
        for key, text in entry.items():
            if key not in {"sign", "position"} and not isinstance(text, str):
                raise self.error(f"{place} {key}", f"is {text!r}; text was expected.")
        sources = {key: text for key, text in entry.items() if key not in {"unit", "sign", "position"}}
        units, default = SIGNAL_UNITS.get(like or name), DEFAULT_UNIT.get(like or name, "")
        if name == "time":
            units, default = dict.fromkeys(TIME_UNITS, 1.0), "auto"
        unit = entry.get("unit", default)
        sign = self.number(entry.get("sign", 1), f"{place} sign")
        if abs(sign) != 1:
            raise self.error(f"{place} sign", f"is {sign:g}; 1 or -1 was expected.")
        if units is not None and unit not in units:
            raise self.error(f"{place} unit", f"is {unit!r}; one of {', '.join(units)} was expected.")
        factor = 1.0 if units is None else units[unit]
        return Signal(name=name, sources=sources, unit=unit, factor=sign * factor, position=position)

    def is_guessed(self, block: Mapping[str, Any], key: str, place: str) -> bool:
        """Whether a value is marked as a guess: by true, or by the guessed value as long as it is unchanged."""
        mark = block.get(key + GUESSED, False)
        if isinstance(mark, bool):
            return mark
        if isinstance(mark, str) is not isinstance(block[key], str):
            expected = f"the guessed value of {key}, true or false was expected."
            raise self.error(f"{place} {key}{GUESSED}", f"is {mark!r}; {expected}")
        return bool(mark == block[key])

    def require(self, block: Mapping[str, Any], key: str, place: str, mend: str) -> None:
        """Refuse a block without this key."""
        if key not in block:
            raise self.error(place, f"has no {key}.", mend)

    def refuse_both(self, block: Mapping[str, Any], key: str, others: Iterable[str], place: str) -> None:
        """Refuse a block that has one of the ``others`` next to ``key``."""
        if twice := [other for other in others if other in block]:
            raise self.error(place, f"has {key} and {twice[0]}; one of them was expected.", "Delete one.")

    def place_of(self, block: Mapping[str, Any], place: str) -> tuple[float, float]:
        """The ``position`` of a block in m."""
        pair = block["position"]
        if not isinstance(pair, list) or len(pair) != 2:
            text = f"is {pair!r}; two numbers in m were expected, ahead and to starboard."
            raise self.error(f"{place} position", text, "Write position = [-0.4, 0.2].")
        x, y = (self.number(number, f"{place} position") for number in pair)
        return x, y
