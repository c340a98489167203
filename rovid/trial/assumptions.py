"""Placeholder values of `rovid init` that nobody has confirmed, and the results that depend on them."""

import re
from dataclasses import dataclass

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

    def __or__(self, other: "Assumptions") -> "Assumptions":
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
        return not self.includes_curve and len(self.items) in {0, self.thrusters}

    @property
    def listing(self) -> str:
        """The guessed values, as "yaw_arm and curve of fore and aft"."""
        names: dict[str, list[str]] = {}
        for item in self.items:
            quantity, _, name = item.partition(" of ")
            names.setdefault(quantity, []).append(name)
        quantities: dict[str, list[str]] = {}
        for quantity, thrusters in names.items():
            *first, last = thrusters
            join = f"{', '.join(first)} and {last}" if first else last
            quantities.setdefault(join, []).append(quantity)
        return " and ".join(f"{' and '.join(together)} of {thrusters}" for thrusters, together in quantities.items())

    @property
    def quantities(self) -> str:
        """The guessed quantities without the thrusters' names: "yaw_arm and curve"."""
        return " and ".join(dict.fromkeys(item.partition(" of ")[0] for item in self.items))

    @property
    def curve_clause(self) -> str:
        """Clause for a sentence on the simulation, with commas; empty where the curves are known."""
        return ", with a guessed thrust curve," if self.includes_curve else ""

    @property
    def caution(self) -> str:
        """Sentences at the head of each result; empty where nothing is guessed."""
        if not self.items:
            return ""
        return f"Guessed by rovid init, not measured: {self.listing}. {self._consequence}"

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

    @property
    def _consequence(self) -> str:
        if self.includes_curve:
            return "Inertia, drag and their ratios are placeholders, and a cause may be an error of the guessed curve."
        if not self.ratios_hold:
            return "Inertia, drag and their ratios are placeholders until every arm is measured."
        condition = " if these arms are equal in size" if self.thrusters > 1 else ""
        return f"Inertia, drag and every torque are placeholders; ratios and times hold{condition}."

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
        if self.is_placeholder(unit):
            return f"guessed {number}"
        return number

    def mark_sentence(self, sentence: str) -> str:
        """``sentence`` with each number in N m, N or kg marked."""
        if not self:
            return sentence
        return _FORCE_NUMBER.sub(r"guessed \g<0>", sentence)


def scales_with_thrust(unit: str) -> bool:
    """Whether a quantity in ``unit`` is proportional to thrust."""
    return unit == "N" or unit.startswith(("N ", "kg"))
