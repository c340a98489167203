"""What each simulator's format holds of the model, as the page's table."""

from __future__ import annotations

from collections.abc import Mapping

from rovid.export import FORMATS
from rovid.export.run_export import Exported, Loss
from rovid.present.number_text import NOTHING, number
from rovid.present.tables.table import Grid, Table, of_numbers, of_text, of_unlike


def formats_grid(exports: Mapping[str, Exported]) -> Grid:
    """How far each format's own equation is from the model, and what it does not hold."""
    table = Table(
        "Yaw rate of each format's own equation against the model's",
        of_text("format"),
        of_text("file"),
        of_numbers("off by", "% of range"),
        # Sizes so far apart share no decimal point.
        of_unlike("rms", "rad/s"),
        of_numbers("of what it holds", "% of range"),
        of_text("not held, % of range"),
    )
    for name, made in exports.items():
        off_by = number(made.mismatch.percent_of_range, ".2g")
        rms = number(made.mismatch.rms, ".2g")
        of_held = number(made.held.percent_of_range, ".2g")
        not_held = "; ".join(map(_sized, made.losses)) or NOTHING
        table.add(name, FORMATS[name], off_by, rms, of_held, not_held)
    return table.grid()


def _sized(loss: Loss) -> str:
    """What is lost, with its percent of the range."""
    return f"{_name(loss)} {number(loss.percent_of_range, '.2g')}"


def _name(loss: Loss) -> str:
    """What is lost, in words."""
    what, _, form = loss.what.replace("_", " ").partition(":")
    if not form:
        return what
    return f"{what} ({form})"


def reasons(exports: Mapping[str, Exported]) -> list[tuple[str, str, str]]:
    """Formats, what they do not hold, and why; each reason once."""
    found: dict[tuple[str, str], list[str]] = {}
    for name, made in exports.items():
        for loss in made.losses:
            found.setdefault((_name(loss), loss.why), []).append(name)
    return [(", ".join(names), what, why) for (what, why), names in found.items()]
