"""What each simulator's format holds of the model, as the page's table."""

from __future__ import annotations

from collections.abc import Mapping

from rovid.export import EXPORTERS, Exported, Loss
from rovid.report.grids import Column, Grid, numbers, words
from rovid.report.text import NOTHING, number


def formats_grid(exports: Mapping[str, Exported]) -> Grid:
    """How far each format's own equation is from the model, and what it does not hold."""
    made = exports.values()
    return Grid(
        caption="Yaw rate of each format's own equation against the model's",
        columns=(
            words("format", exports),
            words("file", [EXPORTERS[name][1] for name in exports]),
            numbers("off by", "% of range", [number(each.mismatch.percent_of_range, ".2g") for each in made]),
            # Sizes so far apart share no decimal point.
            Column(title="rms", unit="rad/s", cells=tuple(number(each.mismatch.rms, ".2g") for each in made)),
            numbers("of what it holds", "% of range", [number(each.held.percent_of_range, ".2g") for each in made]),
            words("not held, % of range", ["; ".join(map(_sized, each.losses)) or NOTHING for each in made]),
        ),
    )


def _sized(loss: Loss) -> str:
    return f"{_name(loss)} {number(loss.percent_of_range, '.2g')}"


def _name(loss: Loss) -> str:
    what, _, form = loss.what.replace("_", " ").partition(":")
    return f"{what} ({form})" if form else what


def reasons(exports: Mapping[str, Exported]) -> list[tuple[str, str, str]]:
    """Formats, what they do not hold, and why; each reason once."""
    found: dict[tuple[str, str], list[str]] = {}
    for name, made in exports.items():
        for loss in made.losses:
            found.setdefault((_name(loss), loss.why), []).append(name)
    return [(", ".join(names), what, why) for (what, why), names in found.items()]
