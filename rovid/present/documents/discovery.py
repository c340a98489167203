"""The document of `rovid discover --json`."""

from __future__ import annotations

from typing import Any

from rovid.diagnose.formulas.discovery import Discovery, Formula, units_of


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
