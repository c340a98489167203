"""Settings of rovid.toml that results depend on; a parameter file stores them to detect later changes."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rovid.trial.assumptions import Assumptions
from rovid.trial.vehicle import Vehicle

_DIGEST = "sha256 "


def _digest(text: str) -> str:
    return _DIGEST + hashlib.sha256(text.encode()).hexdigest()


def prior_digest(table: Mapping[str, Any], vehicle: Vehicle, folder: Path) -> str:
    """Digest of [planar.prior], of its file, and of the vehicle's mass and size, which added masses depend on."""
    sizes = [vehicle.mass, vehicle.length, vehicle.width, vehicle.height, vehicle.rigid_body_inertia]
    file = folder / str(table.get("file", ""))
    return _digest(repr((table, sizes)) + (file.read_text(errors="replace") if file.is_file() else ""))


@dataclass(frozen=True, kw_only=True)
class ConfigFingerprint:
    """Settings that torque, or force, and signals were read with; comments and the order of lines do not count."""

    #: Setting -> value, as "yaw_arm of fore" -> "0.43"; for a thrust curve the digest of its points.
    drive: Mapping[str, str] = field(default_factory=dict)
    signals: Mapping[str, str] = field(default_factory=dict)  #: Signal of the motion -> source, unit and sense.
    further: Mapping[str, str] = field(default_factory=dict)  #: The same for further channels.
    guessed: tuple[str, ...] = ()  #: Keys of ``drive`` that are guesses of `rovid init`.

    @property
    def assumptions(self) -> Assumptions:
        """Guessed values of the vehicle."""
        thrusters = sum(name.startswith("curve of ") for name in self.drive)
        return Assumptions(items=self.guessed, thrusters=thrusters)

    def changes(self, now: "ConfigFingerprint", *, drive_alone: bool = False) -> list[str]:
        """Differences of ``now`` from this fingerprint; a new further channel is no change."""
        found = list(_changes(self.drive, now.drive))
        if not drive_alone:
            known = {name: value for name, value in now.further.items() if name in self.further}
            found += [*_changes(self.signals, now.signals), *_changes(self.further, known)]
        return list(dict.fromkeys(found))


def _subject(name: str) -> str:
    """Thruster of a setting such as "yaw_arm of fore"; a signal's own name."""
    return name.partition(" of ")[2] or name


def _changes(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    for name, value in before.items():
        if name not in now:
            yield f"{_subject(name)} is gone"
        elif now[name] != value:
            yield f"{name} has changed" if value.startswith(_DIGEST) else f"{name} was {value} and is {now[name]}"
    for name in now:
        if name not in before:
            yield f"{_subject(name)} is new"


def config_fingerprint(vehicle: Vehicle, signals: Mapping[str, str], further: Mapping[str, str]) -> ConfigFingerprint:
    """Fingerprint of ``vehicle`` with these ``signals`` and ``further`` channels."""
    axis = vehicle.axis
    drive: dict[str, str] = {}
    for thruster in vehicle.thrusters:
        if (steering := thruster.steering) is not None:
            key = "wheelbase" if steering.wheels else "coefficient"
            drive[f"{key} of {thruster.name}"] = f"{steering.size:.12g}, with {steering.speed}"
            continue
        if (rudder := thruster.rudder) is not None:
            drive[f"position of {thruster.name}"] = f"{list(rudder.position)}"
            drive[f"rudder of {thruster.name}"] = f"lift {rudder.lift}, behind {rudder.behind or 'nothing'}"
            continue
        if thruster.turns:
            drive[f"azimuth of {thruster.turns}"] = "logged"
            continue
        if thruster.curve is None:
            drive[thruster.name if thruster.is_rate_order else axis.force_name] = "logged"
            continue
        points = zip(thruster.curve.command.tolist(), thruster.curve.thrust.tolist(), strict=True)
        text = "\n".join(f"{command!r},{thrust!r}" for command, thrust in points)
        drive[f"{axis.arm_key} of {thruster.name}"] = f"{thruster.arm:.12g}"
        drive[f"curve of {thruster.name}"] = _digest(text)
        drive[f"outside of {thruster.name}"] = "clamp" if thruster.clamp else "refuse"
        if thruster.surge_share:
            drive[f"surge of {thruster.name}"] = f"{thruster.surge_share:.12g}"
        if vehicle.planar:
            drive[f"sway of {thruster.name}"] = f"{thruster.sway_share:.12g}"
    if vehicle.thrust_scale_error:
        drive["thrust_scale_error"] = f"{vehicle.thrust_scale_error:.12g}"
    return ConfigFingerprint(drive=drive, signals=signals, further=further, guessed=vehicle.assumptions.items)
