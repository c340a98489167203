"""Orientations in tables: a heading, roll or pitch from the four columns of a quaternion."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rovid.readers.raw_log import ANGLES, Channel, euler
from rovid.trial.axis import Signal

# A component: "orientation.x", "qx", "Rotation X", ".../orientation/x", and "q[0]" of PX4, where w is the first.
_COMPONENT = re.compile(r"(?i)(?:(.*?)[ ./_\[]?([xyzw])\]?|(.*q)\[([0-3])\])")
_WORDS = {"attitude", "ori", "orientation", "q", "quat", "quaternion", "rot", "rotation"}
_PX4 = {"0": "w", "1": "x", "2": "y", "3": "z"}


def orientations(names: Sequence[str]) -> dict[str, dict[str, str]]:
    """Source of each orientation -> column of its components x, y, z and w."""
    found: dict[str, dict[str, str]] = {}
    for name in names:
        if match := _COMPONENT.fullmatch(name):
            stem = match[1] if match[2] else match[3]
            found.setdefault(stem, {})[match[2].lower() if match[2] else _PX4[match[4]]] = name
    whole = {stem: parts for stem, parts in found.items() if len(parts) == len("xyzw")}
    return {stem: parts for stem, parts in whole.items() if set(re.findall(r"[a-z]+", stem.lower())[-1:]) & _WORDS}


def split_orientations(signals: Mapping[str, Signal], names: Collection[str], kind: str) -> dict[str, Signal]:
    """``signals`` with a signal for each component of an orientation among the columns ``names``."""
    known = orientations(tuple(names))
    split: dict[str, Signal] = {}
    for name, signal in signals.items():
        source = signal.sources[kind]
        if name in ANGLES and source not in names and source in known:
            split |= {f"{name}.{part}": replace(signal, sources={kind: known[source][part]}) for part in "xyzw"}
        else:
            split[name] = signal
    return split


def join_orientations(channels: Mapping[str, Channel], signals: Mapping[str, Signal], kind: str) -> dict[str, Channel]:
    """Channels of ``signals``, with angles in rad in place of the components of `split_orientations`."""
    joined: dict[str, Channel] = {}
    for name, signal in signals.items():
        parts = [channels[f"{name}.{part}"] for part in "xyzw" if f"{name}.{part}" in channels]
        if len(parts) == len("xyzw"):
            angle = euler(np.column_stack([part.values for part in parts]), name)
            joined[name] = replace(parts[0], source=signal.sources[kind], values=angle, radians=True)
        elif name in channels:
            joined[name] = channels[name]
    return joined
