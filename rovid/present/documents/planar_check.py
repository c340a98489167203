"""The document of `rovid check --axes planar --json`."""

from __future__ import annotations

import math
from typing import Any

from rovid.preflight.check import remark_document
from rovid.preflight.planar_check import PlanarCheck
from rovid.present.documents.fits import fault_documents, guess_document
from rovid.trial.axis import PLANAR
from rovid.trial.vehicle import Vehicle


def planar_check_document(checked: PlanarCheck, vehicle: Vehicle) -> dict[str, Any]:
    """The document; SI and radians, null where unknown."""
    return {
        "schema": "rovid-check/1",
        "axes": PLANAR.name,
        **guess_document(vehicle.assumptions),
        "verdict": checked.verdict,
        "logs": [
            {
                "name": trial.name,
                "duration": trial.duration,
                "readings": {name: len(one.time) for name, one in trial.readings.items()},
                "remarks": list(map(remark_document, trial.remarks)),
            }
            for trial in checked.trials
        ],
        "sensors": [_known(vars(sensor)) for sensor in checked.sensors],
        "degrees_of_freedom": [_known(vars(axis)) for axis in checked.axes],
        "latencies": [_known(vars(lag)) for lag in checked.lags],
        "unreadable": [{"name": name, "problem": problem} for name, problem in checked.problems.items()],
        "faults": fault_documents(checked.faults),
        "remarks": list(map(remark_document, checked.remarks)),
        "advice": list(map(vars, checked.advice)),
    }


def _known(values: dict[str, Any]) -> dict[str, Any]:
    return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in values.items()}
