"""What each simulator's format holds of the model, as the page's table."""

from __future__ import annotations

from collections.abc import Mapping

from rovid.export import FORMATS
from rovid.export.run_export import ExportLoss, VerifiedExport
from rovid.present.number_text import NOTHING, format_number
from rovid.present.tables.table import ResultTable, TableBuilder, mixed_number_column, number_column, text_column


def formats_table(exports: Mapping[str, VerifiedExport]) -> ResultTable:
    """How far each format's own equation is from the model, and what it does not hold."""
    table = TableBuilder(
        "Yaw rate of each format's own equation against the model's",
        text_column("format"),
        text_column("file"),
        number_column("off by", "% of range"),
        # Sizes so far apart share no decimal point.
        mixed_number_column("rms", "rad/s"),
        number_column("of what it holds", "% of range"),
        text_column("not held, % of range"),
    )
    for name, made in exports.items():
        off_by = format_number(made.mismatch.percent_of_range, ".2g")
        rms = format_number(made.mismatch.rms, ".2g")
        of_held = format_number(made.kept_mismatch.percent_of_range, ".2g")
        not_held = "; ".join(map(_sized, made.losses)) or NOTHING
        table.add(name, FORMATS[name].file, off_by, rms, of_held, not_held)
    return table.grid()


def _sized(loss: ExportLoss) -> str:
    """What is lost, with its percent of the range."""
    return f"{_name(loss)} {format_number(loss.percent_of_range, '.2g')}"


def _name(loss: ExportLoss) -> str:
    """What is lost, in words."""
    what, _, form = loss.what.replace("_", " ").partition(":")
    if not form:
        return what
    return f"{what} ({form})"


def loss_reasons(exports: Mapping[str, VerifiedExport]) -> list[tuple[str, str, str]]:
    """Formats, what they do not hold, and why; each reason once."""
    found: dict[tuple[str, str], list[str]] = {}
    for name, made in exports.items():
        for loss in made.losses:
            found.setdefault((_name(loss), loss.why), []).append(name)
    return [(", ".join(names), what, why) for (what, why), names in found.items()]
