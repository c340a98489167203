"""Settings of rovid.toml that results depend on: their fingerprint, and the guesses of `rovid init` among them.

A parameter file stores the fingerprint, which shows later changes.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rovid.core.errors import join_words

if TYPE_CHECKING:  # The vehicle contains its assumptions.
    from rovid.trial.vehicle import Vehicle

_NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?"
# A number, with its error, in a unit of force, torque or mass.
_FORCE_NUMBER = re.compile(rf"(?<!guessed )(?<![-.\d])(?<!± ){_NUMBER}(?: ± {_NUMBER})?(?= (?:N|kg)\b)")


@dataclass(frozen=True, kw_only=True)
class Assumptions:
    """Thruster arms and thrust curves that were guessed; false where there are none.

    Where all arms are guessed and the curves are known, the torque is right up to one factor: inertia and drag are
    placeholders, and their ratios hold. A guessed curve, or a guessed arm next to a known one, changes the shape of the
    torque: then no fitted value holds.
    """

    items: tuple[str, ...] = ()  #: Guessed values, as "yaw_arm of fore" and "curve of aft".
    thrusters: int = 0  #: Number of thrusters.

    def __bool__(self) -> bool:
        return bool(self.items)

    def __or__(self, other: Assumptions) -> Assumptions:
        """Union of both."""
        items = tuple(dict.fromkeys((*self.items, *other.items)))
        return Assumptions(items=items, thrusters=max(self.thrusters, other.thrusters))

    @property
    def includes_curve(self) -> bool:
        """Whether a thrust curve is guessed."""
        return any(item.startswith("curve of ") for item in self.items)

    @property
    def includes_coefficient(self) -> bool:
        """Whether the coefficient of a rudder is guessed."""
        return any(item.startswith("coefficient of ") for item in self.items)

    @property
    def ratios_hold(self) -> bool:
        """Whether the guesses are one common factor on all torques, so that ratios of torques hold."""
        is_one = len(self._quantities) < 2 and not self.includes_curve
        return is_one and len(self.items) in {0, self.thrusters}

    @property
    def listing(self) -> str:
        """The guessed values, as "yaw_arm and curve of fore and aft"."""
        names: dict[str, list[str]] = {}
        for item in self.items:
            quantity, _, name = item.partition(" of ")
            names.setdefault(quantity, []).append(name)
        quantities: dict[str, list[str]] = {}
        for quantity, thrusters in names.items():
            quantities.setdefault(join_words(thrusters), []).append(quantity)
        return join_words([f"{' and '.join(together)} of {thrusters}" for thrusters, together in quantities.items()])

    @property
    def quantities(self) -> str:
        """The guessed quantities without the thrusters' names: "yaw_arm and curve"."""
        return " and ".join(self._quantities)

    @property
    def _quantities(self) -> dict[str, None]:
        return dict.fromkeys(item.partition(" of ")[0] for item in self.items)

    @property
    def curve_clause(self) -> str:
        """Clause for a sentence on the simulation, with commas; empty where the curves are known."""
        return ", with a guessed thrust curve," if self.includes_curve else ""

    @property
    def caution(self) -> str:
        """Sentences at the head of each result; empty where nothing is guessed."""
        if not self.items:
            return ""
        consequence = "Inertia, drag and their ratios are placeholders until every arm is measured."
        if self.includes_curve:
            consequence = "Inertia, drag and their ratios are placeholders, and a cause may be an error of the guessed "
            consequence += "curve."
        elif self.ratios_hold:
            condition = " if these arms are equal in size" if self.thrusters > 1 else ""
            consequence = f"Inertia, drag and every torque are placeholders; ratios and times hold{condition}."
        none_guessed = all(item.startswith("coefficient of ") for item in self.items)
        lead = "Not measured" if none_guessed else "Guessed by rovid init, not measured"
        return f"{lead}: {self.listing}. {consequence}"

    @property
    def file_notice(self) -> str:
        """Notice for an exported file, without the thrusters' names, which may hold any character."""
        return "PLACEHOLDERS: arms or thrust curves are guesses." if self else ""

    @property
    def refusal(self) -> str:
        """Reason not to export dependent values, and the remedy; empty where nothing is guessed."""
        if not self.items:
            return ""
        text = f"depends on values guessed by rovid init ({self.listing}): torques, gains and inertia would be "
        text += "placeholders. Write the measured values into rovid.toml and run `rovid report`. If a guess is right, "
        return f"{text}delete its line with _guessed."

    def effect_caveat(self, effect: str) -> str:
        """Caveat for the effect with the id ``effect`` if an error of a guess looks the same; else empty."""
        mimics = self.includes_curve or (self.thrusters > 1 and effect == "thruster_imbalance")
        if not self or not mimics:
            return ""
        return f"found with guessed {self.listing}: it may be an error of the guess"

    def is_placeholder(self, unit: str) -> bool:
        """Whether a number in ``unit`` depends on a guess; roots of a torque do, too."""
        return bool(self) and (not self.ratios_hold or re.search(r"\b(N|kg)\b", unit) is not None)

    def mark_number(self, number: str, unit: str) -> str:
        """``number`` as "guessed 12" if it is a placeholder."""
        return f"guessed {number}" if self.is_placeholder(unit) else number

    def mark_sentence(self, sentence: str) -> str:
        """``sentence`` with each number in N m, N or kg marked."""
        return _FORCE_NUMBER.sub(r"guessed \g<0>", sentence) if self else sentence


def scales_with_thrust(unit: str) -> bool:
    """Whether a quantity in ``unit`` is proportional to thrust."""
    return thrust_exponent(unit) == 1.0


def thrust_exponent(unit: str) -> float:
    """Power of a common factor on all thrust to which a quantity in ``unit`` is proportional."""
    if unit == "N" or unit.startswith(("N ", "kg")):
        return 1.0
    return {"N^0.5": 0.5, "1/(N": -1.0}.get(unit.partition(" ")[0], 0.0)


# --- fingerprint of rovid.toml ---------------------------------------------------------------------------------

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

    def changes(self, now: ConfigFingerprint, *, drive_alone: bool = False) -> list[str]:
        """Differences of ``now`` from this fingerprint; a new further channel is no change."""
        found = list(_changes(self.drive, now.drive))
        if not drive_alone:
            known = {name: value for name, value in now.further.items() if name in self.further}
            found += [*_changes(self.signals, now.signals), *_changes(self.further, known)]
        return list(dict.fromkeys(found))


def _changes(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    for name in {**before, **now}:
        # Thruster of a setting such as "yaw_arm of fore"; a signal's own name.
        subject = name.partition(" of ")[2] or name
        if name not in now:
            yield f"{subject} is gone"
        elif name not in before:
            yield f"{subject} is new"
        elif now[name] != before[name]:
            is_digest = before[name].startswith(_DIGEST)
            yield f"{name} has changed" if is_digest else f"{name} was {before[name]} and is {now[name]}"


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
