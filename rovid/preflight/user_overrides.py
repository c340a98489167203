"""What somebody puts in by hand of a first rovid.toml: it takes the place of what was guessed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from rovid.preflight.raw_columns import SignalGuess
from rovid.preflight.signal_guess import ColumnMapping
from rovid.preflight.thruster_guess import ThrusterCommand
from rovid.trial.trial import Exclusion

CHOSEN = "chosen by hand"


@dataclass(frozen=True, kw_only=True)
class UserOverrides:
    """What was put in.

    Attributes
    ----------
    name
        Of the vehicle; empty where nobody said it.
    size
        mass in kg, length and width in m, as far as they are known.
    signals
        Format -> name in rovid.toml -> what it is taken from; None where all is left as guessed.
    commands
        Sources of those that are wanted; None where all that were found are.
    arms
        Source of a command -> the thruster's yaw arm in m, as it was measured.
    names
        Source of a command -> what its thruster is called.
    left_out
        Stretches of logs.
    """

    name: str = ""
    size: Mapping[str, float] = field(default_factory=dict)
    signals: Mapping[str, Mapping[str, SignalGuess]] | None = None
    commands: frozenset[str] | None = None
    arms: Mapping[str, float] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)
    exclusions: tuple[Exclusion, ...] = ()

    def apply_to(self, guessed: Mapping[str, ColumnMapping]) -> dict[str, ColumnMapping]:
        """``guessed``, by format, with what was put in."""
        return {kind: self._over(kind, one) for kind, one in guessed.items()}

    def _over(self, kind: str, guessed: ColumnMapping) -> ColumnMapping:
        signals = dict(guessed.signals)
        if self.signals is not None:
            signals = {name: _reasoned(one, signals.get(name)) for name, one in self.signals.get(kind, {}).items()}
        of_signals = {one.source for one in signals.values()}
        wanted = [one for one in guessed.commands if self.commands is None or one.source in self.commands]
        commands = [self._thruster(one) for one in wanted if one.source not in of_signals]
        known = bool(commands) or "torque" in signals
        lacking = [what for what, there in (("heading", "heading" in signals), ("command", known)) if not there]
        every = (*_sources(guessed), *guessed.unused)
        taken = of_signals | {one.source for one in commands}
        unused = tuple(source for source in every if source not in taken)
        return ColumnMapping(signals=signals, commands=tuple(commands), missing=tuple(lacking), unused=unused)

    def _thruster(self, one: ThrusterCommand) -> ThrusterCommand:
        named = replace(one, name=self.names.get(one.source) or one.name)
        if one.source not in self.arms:
            return named
        arm = self.arms[one.source]
        return replace(named, arm=abs(arm), direction=int(np.sign(arm)), direction_known=True, arm_measured=True)


def _sources(guessed: ColumnMapping) -> list[str]:
    return [one.source for one in guessed.signals.values()] + [one.source for one in guessed.commands]


def _reasoned(chosen: SignalGuess, guessed: SignalGuess | None) -> SignalGuess:
    """What was chosen, with the reason of the guess where that is the same."""
    if guessed is not None and replace(chosen, reason="") == replace(guessed, reason=""):
        return guessed
    return replace(chosen, reason=CHOSEN)
