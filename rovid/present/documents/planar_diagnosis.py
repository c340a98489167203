"""Diagnosis of the coupled model as JSON."""

from __future__ import annotations

import math
from typing import Any

from rovid.diagnose.result import discriminating_experiment
from rovid.model.parameter_names import without_form
from rovid.planar.diagnosis import PlanarAssessment, PlanarDiagnosis
from rovid.planar.trial_simulation import SENSOR_UNITS
from rovid.present.documents.diagnosis import conclusion_document
from rovid.present.documents.fits import Document, all_warnings, fault_documents, guess_document
from rovid.present.documents.planar import AXES_DOCUMENT, planar_parameters, undetermined_document
from rovid.store.planar_study import PlanarStudy, open_combinations
from rovid.trial.fault import fault_texts


def planar_diagnosis_document(diagnosis: PlanarDiagnosis, study: PlanarStudy) -> Document:
    """The document of `rovid diagnose --axes planar --json`; angles in rad."""
    guess, faults = study.vehicle.assumptions, study.logs.faults
    final = diagnosis.extended or diagnosis.base
    return {
        "schema": "rovid-diagnosis/1",
        **AXES_DOCUMENT,
        **conclusion_document(diagnosis),
        "base": _assessment(diagnosis.base),
        "horizons": _horizons(diagnosis),
        "extended": _assessment(diagnosis.extended),
        "held_out_gain": _held_out_gain(diagnosis),
        "unexplained": {"share_of_variance": dict(diagnosis.unexplained_shares), "depends_on": []},
        "undetermined": [] if final is None else undetermined_document(open_combinations(final.fit)),
        "not_identifiable": ["thrust_scale", *(() if final is None else final.fit.estimate.refused)],
        "next_experiment": next_planar_experiment(diagnosis),
        **guess_document(guess),
        "faults": fault_documents(faults),
        "warnings": all_warnings(guess, [*fault_texts(faults), *study.remarks(), *diagnosis.warnings]),
    }


def next_planar_experiment(diagnosis: PlanarDiagnosis) -> dict[str, Any]:
    """The next run: one that separates causes, else one that shows an open combination, a cause or nothing new."""
    for finding in (*diagnosis.findings, *diagnosis.suspects):
        discriminating = discriminating_experiment(finding)
        if discriminating is not None:
            return discriminating | {"reason": "more than one cause explains these data equally well"}
    final = diagnosis.extended or diagnosis.base
    if final is None:
        run = "steps and sines of surge, sway and yaw, turning circles both ways, and coast-downs to rest"
        return {"run": run, "reason": "they excite all parameters and effects of the model"}
    if undetermined := final.fit.undetermined:
        run = "the same commands with thrust along the axis that these logs do not excite, on four headings"
        return {"run": run, "reason": undetermined[0].text}
    for finding in (*diagnosis.suspects, *diagnosis.findings):
        return {"run": finding.effect.experiment, "reason": f"it shows {finding.effect.title} by itself"}
    run = "turning circles and zigzags at several speeds, on four headings"
    return {"run": run, "reason": "nothing is missing; turns at speed show couplings and currents first"}


def _assessment(side: PlanarAssessment | None) -> Document | None:
    """A model's parameters, and its errors on held-out trials."""
    if side is None:
        return None
    scores = side.held_out
    units = {f"{speed}_rmse": SENSOR_UNITS[speed] for speed in scores.rmse} | {"heading_error": "rad"}
    parameters = {without_form(name): value for name, value in planar_parameters(side.fit.estimate).items()}
    return {
        "parameters": parameters,
        "undetermined": undetermined_document(open_combinations(side.fit)),
        "held_out": {
            "log_likelihood": scores.log_likelihood,
            **{f"{speed}_rmse": error for speed, error in scores.rmse.items()},
            **{f"heading_error_{horizon:.0f}s": error for horizon, error in scores.heading_errors.items()},
            "units": units,
        },
    }


def _horizons(diagnosis: PlanarDiagnosis) -> list[Document]:
    if diagnosis.base is None or diagnosis.extended is None:
        return []
    base, extended = diagnosis.base.held_out.heading_errors, diagnosis.extended.held_out.heading_errors
    return [
        {"seconds": seconds, "base_deg": math.degrees(error), "extended_deg": math.degrees(extended[seconds])}
        for seconds, error in base.items()
        if seconds in extended
    ]


def _held_out_gain(diagnosis: PlanarDiagnosis) -> Document | None:
    """Errors of both models on held-out trials; None where one of the models is missing."""
    if diagnosis.base is None or diagnosis.extended is None:
        return None
    one, other = diagnosis.base.held_out, diagnosis.extended.held_out
    document: Document = {}
    for speed, error in one.rmse.items():
        floor = diagnosis.noise_floors.get(speed)
        document[f"{speed}_rmse"] = _pair(error, other.rmse.get(speed), SENSOR_UNITS[speed], floor)
    for horizon, error in one.heading_errors.items():
        floor = diagnosis.heading_floors.get(horizon)
        document[f"heading_error_{horizon:.0f}s"] = _pair(error, other.heading_errors.get(horizon), "rad", floor)
    document["log_likelihood"] = _pair(one.log_likelihood, other.log_likelihood, "1", None)
    return document


def _pair(before: float, after: float | None, unit: str, floor: float | None) -> Document:
    return {"base": before, "extended": after, "noise_floor": floor, "unit": unit}
