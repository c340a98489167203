"""The result of `rovid effect try` on a terminal."""

from __future__ import annotations

from rich.console import Console

from rovid.core.formatting import plus_minus
from rovid.diagnose.effect_trial import EffectTrial
from rovid.present.console import print_labelled, print_text, show_warnings
from rovid.present.sentences import cause_title, join_words

# Effects of the catalogue that are listed.
_SHOWN = 5


def show_effect_trial(console: Console, found: EffectTrial, warnings: list[str]) -> None:
    """Print the gains of the tried effect next to each model, and the largest gains of the catalogue."""
    for one in found.tried:
        beside = join_words(list(map(cause_title, one.beside))) or "the plain model"
        print_labelled(console, one.effect.key, f"next to {beside}: {one.effect.equation}")
        values = []
        for parameter in one.effect.parameters:
            name = f"{one.effect.key}.{parameter.name}"
            size = plus_minus(one.estimate.value(name), one.estimate.standard_error(name))
            values.append(f"{parameter.name} {size} {parameter.unit}")
        print_text(console, f"  {', '.join(values)}", 2)
        gains = f"{one.gain:.0f} after the parameter penalty, {one.held_out_gain:.0f} on trials that were not fitted"
        print_text(console, f"  log-likelihood gain: {gains}", 2)
    best = [f"{cause_title(name)} {gain:.0f}" for name, gain in list(found.others.items())[:_SHOWN]]
    print_text(console, f"Gains of the catalogue next to the plain model: {', '.join(best) or 'none'}.")
    show_warnings(console, warnings)
