"""The document of `rovid effect try --json`."""

from __future__ import annotations

from typing import Any

from rovid.diagnose.effect_trial import EffectGain, EffectTrial


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
