"""Exports of the coupled model on a terminal."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from rovid.export.planar_run import VELOCITIES, PlanarMismatch, VerifiedPlanarExport
from rovid.present.console import print_labelled, print_path, print_text, show_warnings
from rovid.present.number_format import format_number
from rovid.present.terminal.results import show_stability


def show_planar_export(console: Console, path: Path, made: VerifiedPlanarExport) -> None:
    """Print the differences between the target's equation and the model, what the target lacks, and its stability."""
    print_path(console, str(path))
    print_text(console, f"re-simulated with the target's equation: {_differences(made.mismatch)}")
    if made.losses:
        print_text(console, f"without the parts that the target lacks: {_differences(made.kept_mismatch)}")
    for loss in made.losses:
        name, largest = max(loss.percent_of_range.items(), key=lambda item: item[1])
        size = f"{format_number(largest, 2)} % of the range of the {name.replace('_', ' ')}"
        print_labelled(console, "Not held:", f"{loss.what}, {size}: {loss.why}.", "red")
    show_stability(console, made.stability)
    show_warnings(console, made.warnings)


def _differences(mismatch: PlanarMismatch) -> str:
    parts = [
        f"{name.replace('_', ' ')} off by {format_number(mismatch.percent_of_range[name], 2)} % of its range, "
        f"{format_number(mismatch.rms[name], 2)} {unit} rms"
        for name, unit in VELOCITIES.items()
    ]
    return "; ".join(parts)
