"""A diagnosis as JSON."""

from __future__ import annotations

import math

from rovid.campaign.axis import Axis
from rovid.diagnose.amplitudes import Amplitudes
from rovid.diagnose.experiments import deciding_experiment, next_experiment
from rovid.diagnose.record import Ahead, Diagnosis, Finding, Side, not_identifiable
from rovid.diagnose.signals import is_driver, signal_of
from rovid.model.names import unit_of, without_form
from rovid.show.fit_documents import Document, axis_document, parameter_document, position_errors, units_of
from rovid.study import Study


def diagnosis_document(diagnosis: Diagnosis, study: Study) -> Document:
    """What `rovid diagnose --json` prints."""
    base, extended, axis = diagnosis.base, diagnosis.extended, study.vehicle.axis
    return {
        "schema": "rovid-diagnosis/1",
        **axis_document(axis),
        "verdict": diagnosis.verdict,
        "base": _side(base, axis),
        "findings": [_finding(finding) for finding in diagnosis.findings],
        "suspects": [_finding(suspect) for suspect in diagnosis.suspects],
        "horizons": [_ahead(ahead, axis) for ahead in diagnosis.horizons],
        "extended": _side(extended, axis),
        "held_out_gain": None
        if base is None or extended is None
        else _gain(base, extended, diagnosis.noise_floor, axis),
        "unexplained": {
            "share_of_torque_variance": diagnosis.unexplained_share,
            "depends_on": list(dict.fromkeys(signal_of(signal) for signal, _ in diagnosis.signals)),
            "signals": [
                {"signal": signal_of(signal), "acts_as": signal.form, "log_likelihood_gain": gain}
                for signal, gain in diagnosis.signals
            ],
        },
        "not_identifiable": list(not_identifiable(study.vehicle)),
        "detectable": {
            f"{effect.id}.{effect.parameters[0].name}": {
                "value": size if math.isfinite(size) else None,
                "unit": unit_of(f"{effect.key}.{effect.parameters[0].name}", axis),
            }
            for effect, size in diagnosis.detectable
        },
        "next_experiment": next_experiment(diagnosis),
        "missing": diagnosis.missing or None,
        **({} if diagnosis.amplitudes is None else {"tables": _tables(diagnosis.amplitudes)}),
        "warnings": [*study.remarks(), *diagnosis.warnings],
    }


def _tables(amplitudes: Amplitudes) -> Document:
    return {
        "predictions": [
            {
                "trial": each.trial,
                "inertia": each.inertia,
                "inertia_method": each.method,
                "peak_yaw_rate": {"measured": each.measured, "predicted": each.predicted, "unit": "rad/s"},
            }
            for each in amplitudes.predictions
        ],
        "plain_model_explains": amplitudes.plain.explains,
        "would_explain": [
            {
                "effect": (effect := cause.model.effects[0]).id,
                "form": effect.form or None,
                "parameters": {name: {"value": value, "unit": unit} for name, (value, unit) in cause.sizes.items()},
                "inertia": cause.model.inertia,
                "chance_of_the_misfit": None if math.isnan(cause.chance) else cause.chance,
                "deciding_experiment": effect.experiment,
            }
            for cause in amplitudes.causes
        ],
        "would_not_explain": [effect.id for effect in amplitudes.ruled_out],
    }


def _side(side: Side | None, axis: Axis) -> Document | None:
    if side is None:
        return None
    held = side.held_out
    return {
        "parameters": {
            # A form of an effect goes by the effect's name: which form fits best is said with the finding.
            without_form(name): value
            for name, value in parameter_document(side.estimate).items()
        },
        "held_out": {
            "log_likelihood": held.log_likelihood,
            f"{axis.rate}_r2": held.rate_r2,
            f"{axis.rate}_rmse": held.rate_rmse,
            **position_errors(held.position_errors, axis),
            "units": units_of(axis),
        },
    }


def _ahead(ahead: Ahead, axis: Axis) -> Document:
    unit = "deg" if axis.angular else "m"
    errors = {f"base_{unit}": ahead.base, f"extended_{unit}": ahead.extended}
    return {"seconds": ahead.seconds, **{name: axis.in_shown(error) for name, error in errors.items()}}


def _finding(finding: Finding) -> Document:
    effect, rivals = finding.effect, [rival for rival in finding.rivals if not is_driver(rival.effect)]
    return {
        "effect": effect.id,
        "form": effect.form or None,
        "parameters": {without_form(n).rpartition(".")[2]: v for n, v in parameter_document(finding.estimate).items()},
        "log_likelihood_gain": finding.gain,
        "held_out_log_likelihood_gain": finding.held_out_gain,
        "runner_up": {"effect": rivals[0].effect.id, "gain": rivals[0].gain} if rivals else None,
        "confidence": finding.confidence,
        "cannot_be_told_from": [other.id for other in finding.undecided],
        "deciding_experiment": deciding_experiment(finding),
    }


def _gain(base: Side, extended: Side, floor: float, axis: Axis) -> Document:
    def pair(before: float | None, after: float | None, unit: str) -> Document:
        return {"base": before, "extended": after, "unit": unit}

    one, other = base.held_out, extended.held_out
    return {
        f"{axis.rate}_rmse": pair(one.rate_rmse, other.rate_rmse, axis.rate_unit) | {"noise_floor": floor},
        f"{axis.rate}_r2": pair(one.rate_r2, other.rate_r2, "1"),
        **{
            f"{axis.position}_error_{horizon:.0f}s": pair(error, other.position_errors[horizon], axis.unit("rad"))
            for horizon, error in one.position_errors.items()
        },
        "log_likelihood": pair(one.log_likelihood, other.log_likelihood, "1"),
    }
