"""Trials of an effect, and formulas that were discovered, as JSON."""

from __future__ import annotations

from typing import Any

from rovid.diagnose.effect_trial import EffectGain, EffectTrial
from rovid.diagnose.formulas.discovery import Discovery, Formula, units_of


def effect_trial_document(found: EffectTrial, warnings: list[str]) -> dict[str, Any]:
    """Gains of the tried effect and of the catalogue's."""
    others = [{"effect": name, "log_likelihood_gain": gain} for name, gain in found.others.items()]
    return {
        "schema": "rovid-effect/1",
        "tried": [_gain(one) for one in found.tried],
        "catalogue": others,
        "warnings": warnings,
    }


def _gain(one: EffectGain) -> dict[str, Any]:
    estimate, key = one.estimate, one.effect.key
    parameters = {
        parameter.name: {
            "value": estimate.value(f"{key}.{parameter.name}"),
            "standard_error": estimate.standard_error(f"{key}.{parameter.name}"),
            "unit": parameter.unit,
        }
        for parameter in one.effect.parameters
    }
    return {
        "effect": key,
        "beside": list(one.beside),
        "log_likelihood_gain": one.gain,
        "held_out_gain": one.held_out_gain,
        "parameters": parameters,
    }


def discovery_document(found: Discovery, warnings: list[str]) -> dict[str, Any]:
    """Formulas, best first, and the causes of the catalogue next to which they predict."""
    return {
        "schema": "rovid-discovery/1",
        "formulas": [_formula(found, formula) for formula in found.formulas],
        "causes": list(found.causes),
        "missing": found.missing or None,
        "warnings": warnings,
    }


def _formula(found: Discovery, formula: Formula) -> dict[str, Any]:
    estimate, units = formula.estimate, units_of(formula, found.grammar.units if found.grammar else {})
    parameters = {
        name: {"value": estimate.value(name), "standard_error": estimate.standard_error(name), "unit": units[name]}
        for name in estimate.names
    }
    return {
        "formula": formula.text,
        "signals": list(formula.signals),
        "parameters": parameters,
        "log_likelihood_gain": formula.gain,
        "held_out_gain": formula.held_out_gain,
        "held_out_log_likelihood_gain": formula.held_out_nats,
        "inclusion": formula.inclusion,
        "nearest": formula.nearest,
        "code_length": formula.price,
        "beside": list(formula.beside),
    }
