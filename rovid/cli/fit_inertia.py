"""``rovid fit-inertia``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from rovid.cli.context import (
    busy,
    claim_of,
    compared,
    console,
    opened,
    print_json,
    put,
    remembered,
    standing_now,
    stored_at,
)
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Cutoff, Force, Json, OptionalLogs, ParameterFile

if TYPE_CHECKING:
    from rovid.core.atomic_write import OutputSet
    from rovid.store.parameter_file import Parameters
    from rovid.store.study import Study

PAGE = Page(
    text="""
    Reads logs with sines, or with any changing command, or a table of sine trials with the columns period_s,
    torque_amplitude_Nm and peak_yaw_rate_rad_s; and the drag of the parameter file, if it is there. Prints the
    inertia by the orbit integral, harmonic balance, regression and the peak method side by side, says which one
    it took, and writes that to the parameter file (kg m^2, or kg along surge, sway and heave), with added inertia
    printed beside it.

    Use it after fit-drag. Where the methods differ by more than their errors, the model misses something: run
    diagnose.
    """,
    examples=(
        ("With the logs that fit-drag remembered", "rovid fit-inertia"),
        (
            "From a table of sine trials, with the drag in tables.toml",
            "rovid fit-inertia my_tables/sine_trials.csv -p tables.toml",
        ),
        ("With a filter of 1 Hz in place of the one chosen", "rovid fit-inertia --cutoff 1"),
    ),
    see=("rovid fit-drag", "rovid fit", "rovid simulate"),
)


def fit_inertia(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find inertia from sines, by four methods."""
    stored = stored_at(parameters, axis, force=force)
    paths = logs or remembered(stored)
    claim = claim_of([stored.output], paths, force=force)
    study = opened(paths, cutoff, stored.axis)
    estimate_inertia(study, stored, claim, json=json)


def estimate_inertia(study: Study, stored: Parameters, claim: OutputSet, *, json: bool) -> None:
    """Fit, put what was found into the parameter file, and print it."""
    from rovid.present.documents.fits import inertia_document
    from rovid.present.terminal.results import show_fit, show_inertia

    stored, notes = standing_now(stored, study)
    with busy("Fitting inertia …"):
        result = study.inertia(stored.independent_drag())
    result = replace(result, estimate=compared(stored, study, result.estimate, notes))
    stored = put(stored, claim, study, result.estimate)
    if json:
        print_json(inertia_document(result, study))
    else:
        show_fit(console(), result, show_inertia, study, stored)
