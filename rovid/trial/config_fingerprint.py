"""What of rovid.toml results rest on, in words: told again later, it says whether they still hold."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from rovid.trial.assumptions import Assumptions
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle

_DIGEST = "sha256 "


@dataclass(frozen=True, kw_only=True)
class ConfigFingerprint:
    """What a vehicle's torque, or force, and its signals were read by; comments and the order of lines are no part.

    Attributes
    ----------
    drive
        What it is -> its value, as "yaw_arm of fore" -> "0.43"; of a thrust curve the digest of its points.
    signals
        Name of each signal of the motion -> where it stands, its unit and sense.
    further
        The same of channels that are carried along.
    guessed
        What of ``drive`` is a guess of `rovid init`.
    """

    drive: Mapping[str, str] = field(default_factory=dict)
    signals: Mapping[str, str] = field(default_factory=dict)
    further: Mapping[str, str] = field(default_factory=dict)
    guessed: tuple[str, ...] = ()

    @property
    def assumptions(self) -> Assumptions:
        """The same of a vehicle that is not at hand."""
        thrusters = sum(name.startswith("curve of ") for name in self.drive)
        return Assumptions(items=self.guessed, thrusters=thrusters)

    def changes(self, now: ConfigFingerprint, *, drive_alone: bool = False) -> list[str]:
        """What is not as here any more; a further channel that is new changes nothing."""
        found = [*_changes(self.drive, now.drive), *_new(self.drive, now.drive)]
        if not drive_alone:
            found += [*_changes(self.signals, now.signals), *_new(self.signals, now.signals)]
            found += _changes(self.further, now.further)
        return list(dict.fromkeys(found))


def _new(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    for name in now:
        if name not in before:
            yield f"{_thruster_of(name)} is new"


def _thruster_of(name: str) -> str:
    """The thruster that "yaw_arm of fore" is of; a signal by its own name."""
    return name.partition(" of ")[2] or name


def _changes(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    for name, value in before.items():
        if name not in now:
            yield f"{_thruster_of(name)} is gone"
        elif now[name] != value:
            yield f"{name} has changed" if value.startswith(_DIGEST) else f"{name} was {value} and is {now[name]}"


def config_fingerprint(vehicle: Vehicle, signals: Mapping[str, str], further: Mapping[str, str]) -> ConfigFingerprint:
    """What torques of ``vehicle``, these ``signals`` and ``further`` channels rest on."""
    drive: dict[str, str] = {}
    for thruster in vehicle.thrusters:
        drive |= _thruster(thruster, vehicle)
    return ConfigFingerprint(drive=drive, signals=signals, further=further, guessed=vehicle.assumptions.items)


def _thruster(thruster: Thruster, vehicle: Vehicle) -> dict[str, str]:
    axis, name = vehicle.axis, thruster.name
    if thruster.curve is None:
        return {axis.force_name: "logged"}
    told = {
        f"{axis.arm_key} of {name}": f"{thruster.arm:.12g}",
        f"curve of {name}": _digest(thruster.curve),
        f"outside of {name}": "clamp" if thruster.clamp else "refuse",
    }
    if thruster.surge_share:
        told[f"surge of {name}"] = f"{thruster.surge_share:.12g}"
    return told


def _digest(curve: ThrustCurve) -> str:
    points = zip(curve.command.tolist(), curve.thrust.tolist(), strict=True)
    text = "\n".join(f"{command!r},{thrust!r}" for command, thrust in points)
    return _DIGEST + hashlib.sha256(text.encode()).hexdigest()
