"""What is said of clocks that are apart: by how much, how sure that is, and what [join] is to say of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rovid.core.escaping import toml_key
from rovid.core.formatting import plus_minus, round_to_error

# Standard errors from which something shows, and s that matter.
SURE, _MATTERS = 3.0, 0.02
# So many clocks are told one after the other.
_SAID = 8


@dataclass(frozen=True, kw_only=True)
class ClockOffset:
    """How far the clock of a file, or of a part of every trial, is off.

    Attributes
    ----------
    name
        As in [join]: of the file, or of the part where it is the same in all trials.
    offset, error
        s to be added to it, beside what [join] adds, from the file's beginning on where it drifts; its standard error.
    drift, drift_error
        ppm; zeros where none shows.
    by
        Columns that are alike; empty where the vehicle's answers told it.
    given
        s and ppm that [join] adds already.
    middle
        s from the file's beginning to where the offset is known; 0 where it drifts.
    """

    name: str
    offset: float
    error: float
    drift: float = 0.0
    drift_error: float = 0.0
    by: str = ""
    given: tuple[float, float] = (0.0, 0.0)
    middle: float = 0.0

    @property
    def certain(self) -> bool:
        """Whether it is the clock for sure, and no delay; and matters."""
        return self.is_significant and (bool(self.by) or self.offset < 0.0)

    @property
    def is_significant(self) -> bool:
        """Whether it is anything but nothing."""
        return abs(self.offset) > max(SURE * self.error, _MATTERS) or (bool(self.by) and bool(self.drift))

    @property
    def join_settings(self) -> dict[str, str]:
        """What [join] is to say of it, by "offset" and "drift"."""
        key = toml_key(self.name)
        offset, drift = self.given[0] + self.offset, self.given[1] + self.drift
        settings = {"offset": f"{key} = {round_to_error(offset, self.error)}"}
        return settings | ({"drift": f"{key} = {round_to_error(drift, self.drift_error)}"} if self.drift else {})

    @property
    def text(self) -> str:
        """A sentence."""
        size = f"{plus_minus(abs(self.offset), self.error)} s"
        if self.by:
            drifts = f" and {plus_minus(self.drift, self.drift_error)} ppm" if self.drift else ""
            way = "behind" if self.offset > 0.0 else "ahead"
            return f"The clock of {self.name} is {size} {way}{drifts}, by {self.by} in both files."
        if self.certain:
            return (
                f"The vehicle answers {size} before the commands in {self.name}, which cannot be: that clock is so "
                "much ahead, or more by whatever delay the thrusters have."
            )
        if self.is_significant:
            return (
                f"The vehicle answers {size} after the commands in {self.name}: a delay, or a clock that is behind. No "
                "log tells which."
            )
        return f"The vehicle answers the commands in {self.name} at once ({plus_minus(self.offset, self.error)} s)."


@dataclass(frozen=True, kw_only=True)
class ClockOffsets:
    """Of all trials that were joined; ``lag`` is that of the thrusters in s, 0 where none shows beside the clocks."""

    offsets: tuple[ClockOffset, ...] = ()
    lag: float = 0.0

    @property
    def groups(self) -> list[tuple[ClockOffset, ...]]:
        """Those of which the same is to be said."""
        kinds: dict[tuple[bool, ...], list[ClockOffset]] = {}
        for clock in self.offsets:
            kinds.setdefault((clock.certain, clock.is_significant, bool(clock.by)), []).append(clock)
        return [tuple(clocks) for clocks in kinds.values()]

    def text(self, clocks: Sequence[ClockOffset]) -> str:
        """Sentences on some of them, of which the same is to be said."""
        first, *others = clocks
        beside = f" Beside it the thrusters lag by {self.lag:.2g} s." if self.lag and not first.by else ""
        sizes = [f"{other.name} {plus_minus(other.offset, other.error)}" for other in others[:_SAID]]
        more = f" and {len(others) - _SAID} more" if len(others) > _SAID else ""
        likewise = f" Likewise, s to be added: {', '.join(sizes)}{more}." if others else ""
        return f"{first.text}{beside}{likewise}"
