"""What of a vehicle `rovid init` made up and nobody put right since, and which numbers hang on it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

_CURVE = "curve"
_NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?"
# A number, with its error, that is in a unit of force, torque or mass.
_OF_TORQUE = re.compile(rf"(?<!guessed )(?<![-.\d])(?<!± ){_NUMBER}(?: ± {_NUMBER})?(?= (?:N|kg)\b)")


@dataclass(frozen=True, kw_only=True)
class Assumptions:
    """Arms and thrust curves that were not measured; false where there are none.

    Where all arms are guessed alike and the curves are known, torque is right but for one factor: inertia and drag are
    placeholders, their ratios hold. A guessed curve, or one guessed arm beside a known one, has a wrong shape: then
    nothing holds that was fitted through it.

    Attributes
    ----------
    items
        What is guessed, as "yaw_arm of fore" and "curve of aft".
    thrusters
        How many there are.
    """

    items: tuple[str, ...] = ()
    thrusters: int = 0

    def __bool__(self) -> bool:
        return bool(self.items)

    def __or__(self, other: Assumptions) -> Assumptions:
        """Both guesses together."""
        items = tuple(dict.fromkeys((*self.items, *other.items)))
        return Assumptions(items=items, thrusters=max(self.thrusters, other.thrusters))

    @property
    def includes_curve(self) -> bool:
        """Whether the shape of thrust over command is a guess."""
        return any(item.startswith(f"{_CURVE} of ") for item in self.items)

    @property
    def ratios_hold(self) -> bool:
        """Whether what is guessed is one factor on all torque, so that quotients of torques do not hang on it."""
        return not self.includes_curve and len(self.items) in {0, self.thrusters}

    @property
    def listing(self) -> str:
        """What is guessed, as "yaw_arm and curve of fore and aft"."""
        names: dict[str, list[str]] = {}
        for item in self.items:
            what, _, name = item.partition(" of ")
            names.setdefault(what, []).append(name)
        together: dict[str, list[str]] = {}
        for what, those in names.items():
            together.setdefault(_listed(those), []).append(what)
        return " and ".join(f"{' and '.join(whats)} of {those}" for those, whats in together.items())

    @property
    def quantities(self) -> str:
        """The same without the names of thrusters, for whoever was told them: "yaw_arm and curve"."""
        return " and ".join(dict.fromkeys(item.partition(" of ")[0] for item in self.items))

    @property
    def curve_clause(self) -> str:
        """What a sentence on the simulation has to add, with commas; nothing where the curves are known."""
        return ", with a guessed thrust curve," if self.includes_curve else ""

    @property
    def caution(self) -> str:
        """The sentences that every result begins with; empty where nothing is guessed."""
        if not self.items:
            return ""
        return f"Guessed by rovid init, not measured: {self.listing}. {self._consequence}"

    @property
    def file_notice(self) -> str:
        """For a file in any format: without the names of thrusters, which may hold anything."""
        return "PLACEHOLDERS: arms or thrust curves are guesses." if self else ""

    @property
    def refusal(self) -> str:
        """Why nothing is handed on that hangs on it, and how to mend that; empty where nothing is guessed."""
        if not self.items:
            return ""
        return (
            f"rests on a guess of rovid init, {self.listing}: torques, gains and inertia would be placeholders. Put what "
            "was measured into rovid.toml, and run `rovid report`. Of a guess that is right delete the line with "
            "_guessed."
        )

    @property
    def _consequence(self) -> str:
        if self.includes_curve:
            return "Inertia, drag and their ratios are placeholders, and a cause may be what the guessed curve lacks."
        if not self.ratios_hold:
            return "Inertia, drag and their ratios are placeholders until every arm is measured."
        alike = " if these arms are of one size" if self.thrusters > 1 else ""
        return f"Inertia, drag and every torque are placeholders; ratios and times hold{alike}."

    def effect_caveat(self, effect: str) -> str:
        """What is to be said beside a cause with the id ``effect`` that may be the guess itself; else nothing."""
        arms_alone = self.thrusters > 1 and effect == "thruster_imbalance"
        if not self or not (self.includes_curve or arms_alone):
            return ""
        return f"found with guessed {self.listing}: it may be what the guess lacks"

    def is_placeholder(self, unit: str) -> bool:
        """Whether a number in ``unit`` is a placeholder."""
        # Roots of a torque hang on it too.
        return bool(self) and (not self.ratios_hold or re.search(r"\b(N|kg)\b", unit) is not None)

    def mark_number(self, number: str, unit: str) -> str:
        """``number``, which is in ``unit``, as "guessed 12" where it is a placeholder."""
        return f"guessed {number}" if self.is_placeholder(unit) else number

    def mark_sentence(self, sentence: str) -> str:
        """``sentence`` with what it says in N m, N or kg marked likewise."""
        return _OF_TORQUE.sub(r"guessed \g<0>", sentence) if self else sentence


def scales_with_thrust(unit: str) -> bool:
    """Whether what has this ``unit`` is larger by a factor where all thrust is."""
    return unit == "N" or unit.startswith(("N ", "kg"))


def _listed(names: Sequence[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
