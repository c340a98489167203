"""Trials of an effect, and formulas that were discovered, on a terminal."""

from __future__ import annotations

from rich.console import Console

from rovid.core.formatting import plus_minus
from rovid.diagnose.effect_trial import EffectTrial
from rovid.diagnose.formulas.discovery import Discovery, units_of
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


def show_discovery(console: Console, found: Discovery) -> None:
    """Print each formula with its parameters and its evidence."""
    if found.missing:
        print_text(console, f"Too little data: {found.missing}")
        return
    causes = join_words(list(map(cause_title, found.causes)))
    print_text(console, f"Causes of the catalogue that the diagnosis selects: {causes or 'none'}.")
    if not found.formulas:
        print_text(console, "No formula of the logged and derived signals predicts the unexplained torque.")
        return
    print_text(console, "A formula does not prove a cause. Only a run that changes its signals alone can decide.")
    for formula in found.formulas:
        console.print()
        units, estimate = units_of(formula, found.grammar.units if found.grammar else {}), formula.estimate
        values = [
            f"{name} = {plus_minus(estimate.value(name), estimate.standard_error(name))} {units[name]}"
            for name in estimate.names
        ]
        print_labelled(console, "Torque in N m:", formula.text)
        print_text(console, f"  {', '.join(values)}", 2)
        beside = join_words(list(map(cause_title, formula.beside)))
        print_text(
            console,
            f"  log-likelihood gain {formula.gain:.0f} next to {beside or 'the plain model'}, "
            f"{formula.held_out_nats:.0f} on trials that were not fitted",
            2,
        )
        print_text(
            console,
            f"  removes {100.0 * formula.held_out_gain:.0f} % of the free-running rate error (mean square) on trials "
            f"that were not fitted; selected in {100.0 * formula.inclusion:.0f} % of bootstrap draws",
            2,
        )
        nearest = f"similar to {cause_title(formula.nearest)}" if formula.nearest else "similar to no named effect"
        print_text(console, f"  {nearest}")
