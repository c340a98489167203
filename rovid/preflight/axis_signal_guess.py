"""What is measured along an axis but yaw: a position or a velocity, by its name and its unit."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.preflight.raw_columns import FEWEST, RawColumn, SignalGuess, finite_values
from rovid.preflight.thruster_guess import COMMAND, SIDED
from rovid.trial.axis import Axis
from rovid.trial.signal_names import name_words

# What a name must not speak of: what is wished for, what is derived, and what belongs to the instrument.
_NOT_MEASURED = {"set", "setpoint", "desired", "target", "ref", "reference", "error", "err", "std", "sigma", "cmd"}
_NOT_MEASURED |= {"command", "demand", "sp", "soll", "sollwert", "consigne", "consigna", "settpunkt", "ønsket"}
_NOT_MEASURED |= {"joystick", "stick", "manette", "pilot", "rcin", "input", "acc", "accel", "acceleration", "max"}
_NOT_MEASURED |= {"voltage", "current", "temp", "temperature", "pwm", "rpm", "force", "thrust", "torque", "wind"}
_NOT_MEASURED |= {"sound", "schall", "son", "sonido", "bottom", "alarm", "valid", "quality", "status"}
_SPEED = {
    "velocity",
    "vel",
    "speed",
    "v",
    "dvl",
    "rate",
    "gyro",
    "geschwindigkeit",
    "vitesse",
    "velocidad",
    "hastighet",
}
_SPEED |= {"fahrt", "fart", "velocità", "velocita"}
_AHEAD = {"surge", "vx", "ahead", "forward", "longitudinal", "avance", "voraus", "längs", "laengs", "stw"}
_ASIDE = {"sway", "vy", "lateral", "sideways", "transverse", "quer", "latéral", "tverrskips", "travers"}
_UP = {"heave", "vz", "vertical", "vertikal", "climb"}
_VERTICAL = {"vertical", "vertikal", "lateral"}
_DEPTH = {"depth", "tiefe", "profondeur", "immersion", "dybde", "profundidad", "profondità", "profondita"}
_HEIGHT = {"altitude", "height", "höhe", "hoehe", "altitud", "høyde"}
_ROLL = {"roll", "phi", "roulis", "rollwinkel", "kraengung", "krängung", "gite", "gîte", "rull", "rulling", "balanceo"}
_ROLL |= {"escora", "rollio", "heel", "heeling"}
_PITCH = {"pitch", "theta", "tangage", "nick", "nickwinkel", "assiette", "cabeceo", "beccheggio", "stampfwinkel"}
# Axis -> words for it; single letters count where the unit is that of a velocity.
_WORDS: Mapping[str, set[str]] = {
    "surge": _AHEAD,
    "sway": _ASIDE,
    "heave": _UP | _DEPTH | _HEIGHT,
    "roll": _ROLL,
    "pitch": _PITCH,
}
_LETTERS: Mapping[str, str] = {"surge": "ux", "sway": "vy", "heave": "wz", "roll": "p", "pitch": "q"}
# What may stand for the speed ahead where nothing better is there.
_OVER_GROUND = {"sog", "speed", "fahrt", "fart", "vitesse", "velocidad"}
# Ends of names -> unit.
_UNITS: Mapping[str, re.Pattern[str]] = {
    unit: re.compile(rf"(?:^|[^A-Za-z]|(?<=[a-z])(?=[A-Z]))(?i:{ends})\W*$")
    for unit, ends in {
        "mm/s": "mm/s|mm_s|mmps",
        "cm/s": "cm/s|cm_s|cmps",
        "m/s": "m/s|m_s|mps|m s-1",
        "kn": "kn|kt|kts|knots|knoten|noeuds|nudos|knop",
        "deg/s": "deg/s|deg_s|dps|°/s|grad/s|grad_s",
        "rad/s": "rad/s|rad_s|rps",
        "mm": "mm",
        "cm": "cm",
        "m": "m",
        "deg": "deg|degrees|grad|grader|grados|°",
        "rad": "rad|radians",
    }.items()
}
_OF_SPEED = {"mm/s", "cm/s", "m/s", "kn", "deg/s", "rad/s"}


def guessed_along(axis: Axis, every: Mapping[str, Sequence[RawColumn]], asked: str = "") -> dict[str, SignalGuess]:
    """Signal of rovid.toml -> what measures the motion along ``axis``; a position before a velocity, one of each."""
    found: dict[str, tuple[int, SignalGuess]] = {}
    for source, seen in every.items():
        if asked and source != asked and not axis.self_righting:
            continue
        values = finite_values(seen)
        if len(values) < FEWEST or not np.ptp(values) > 0.0:
            continue
        named = name_words(source)
        rank = 9 if source == asked else _rank(axis, source, named)
        if not rank:
            continue
        name, guess = _guess(axis, source, named, values)
        if name not in found or rank > found[name][0]:
            found[name] = (rank, guess)
    if axis.angular and axis.position_signal not in found:
        return {}
    order = (*axis.position_signals, axis.rate_signal)
    return {name: found[name][1] for name in order if name in found}


def _rank(axis: Axis, source: str, named: set[str]) -> int:
    """How plainly a column is named so; 0 where it is not."""
    if named & (_NOT_MEASURED | COMMAND | SIDED):
        return 0
    unit = _unit(source)
    if axis.angular:
        ok = unit in {"", "deg", "rad", "deg/s", "rad/s"}
        return 3 * bool(ok and named & _WORDS[axis.name])
    if unit in {"deg", "rad", "deg/s", "rad/s"}:
        return 0
    # What is vertical without a unit may push that way.
    if named & _WORDS[axis.name] - _VERTICAL or (named & _VERTICAL & _WORDS[axis.name] and (unit or named & _SPEED)):
        return 3
    letters = set(_LETTERS[axis.name]) & named
    if letters and (unit in _OF_SPEED or named & _SPEED):
        return 2
    return int(axis.name == "surge" and bool(named & _OVER_GROUND) and unit in {"", *_OF_SPEED})


def _guess(axis: Axis, source: str, named: set[str], values: FloatArray) -> tuple[str, SignalGuess]:
    """Name of the signal, and the column as it."""
    unit = _unit(source)
    span = f"{values.min():.4g} to {values.max():.4g}"
    speed = unit in _OF_SPEED or (not unit and bool(named & (_SPEED | _OVER_GROUND)) and not named & _DEPTH)
    name = axis.rate_signal if speed else axis.position_signal
    if axis.name == "heave" and not speed and not named & (_DEPTH | _HEIGHT):
        name = "heave_position"
    high = bool(named & _HEIGHT) and not speed
    why = f"named so; {span}{'; a height, turned around to a depth' if high else ''}"
    if unit:
        return name, SignalGuess(
            source=source, unit=unit, sign=-1 if high else 1, reason=f"{why}; the unit by its name", is_rate=speed
        )
    if not axis.angular:
        return name, SignalGuess(
            source=source, unit="m/s" if speed else "m", sign=-1 if high else 1, reason=why, is_rate=speed
        )
    wide = float(np.max(np.abs(values))) > 0.5 * np.pi
    told = "more than upright in radians" if wide else "taken for radians"
    return name, SignalGuess(
        source=source, unit=("deg" if wide else "rad") + "/s" * speed, reason=f"{why}; {told}", is_rate=speed
    )


def _unit(source: str) -> str:
    """By the end of a name; empty where that is none."""
    return next((unit for unit, ends in _UNITS.items() if ends.search(source)), "")
