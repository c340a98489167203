"""Exports of the coupled model as JSON."""

from __future__ import annotations

from rovid.export.planar_run import VELOCITIES, PlanarMismatch, VerifiedPlanarExport
from rovid.present.documents.fits import Document, all_warnings, fields, guess_document
from rovid.present.documents.results import stability_document
from rovid.trial.assumptions import Assumptions


def planar_export_document(name: str, file: str, made: VerifiedPlanarExport, guess: Assumptions) -> Document:
    """The document of `rovid export --axes planar --json`; percentages are of each velocity's range."""
    return {
        "schema": "rovid-export/1",
        "axes": "planar",
        "format": name,
        "file": file,
        "mismatch": _mismatch(made.mismatch),
        "mismatch_of_what_is_held": _mismatch(made.kept_mismatch),
        "not_held": [
            {
                **fields(loss, "what", "why"),
                **{f"{key}_percent_of_range": value for key, value in loss.percent_of_range.items()},
            }
            for loss in made.losses
        ],
        "stability": stability_document(made.stability, VELOCITIES),
        **guess_document(guess),
        "warnings": all_warnings(guess, made.warnings),
    }


def _mismatch(mismatch: PlanarMismatch) -> Document:
    percents = {f"{name}_percent_of_range": value for name, value in mismatch.percent_of_range.items()}
    return {**percents, "rms": dict(mismatch.rms), "unit": dict(VELOCITIES)}
