"""Plots of a page: drafts, their rendering, and the files beside the page."""

import base64
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure

from rovid.core.output_files import PAGE, OutputFile, OutputSet, pdf_signature, png_signature, svg_signature
from rovid.present.plots import canvas
from rovid.trial.assumptions import Assumptions

# File names of the plots of any report.
_FILE_NAMES = re.compile(
    r"(fault_\d\d|thrust_curves|steady_\w+|inertia|residuals|diagnosis_gain|diagnosis_residuals|closed_loop|rivals_\w+|missing_\w+|planar_\w+"
    r"|(sine_runs|overview)(_\d\d+)?|trial_\d\d+_\w*)\.(png|svg)"
)


@dataclass(frozen=True, eq=False)
class FigureDraft:
    """A plot that is not yet rendered: file name without suffix, caption and alternative text."""

    name: str
    figure: Figure
    caption: str = field(kw_only=True)
    alt: str = field(kw_only=True)


@dataclass(frozen=True, kw_only=True)
class ReportFigure:
    """A plot: file name without suffix, caption, alternative text, and its bytes."""

    name: str
    caption: str
    alt: str
    png: bytes
    svg: bytes

    @property
    def data(self) -> str:
        """The PNG in base64."""
        return base64.b64encode(self.png).decode("ascii")


def render_draft(draft: FigureDraft, guess: Assumptions) -> ReportFigure:
    """The plot as PNG and SVG; its assumptions are marked where the unit of an axis depends on them."""
    figure = canvas.mark_guessed(draft.figure, guess)
    png, svg = canvas.render_png(figure), canvas.render_svg(figure)
    return ReportFigure(name=draft.name, caption=draft.caption, alt=draft.alt, png=png, svg=svg)


def plot_files(figures: Iterable[ReportFigure], folder: Path) -> dict[OutputFile, bytes]:
    """Each plot as PNG and as SVG in ``folder``."""
    files = {}
    for figure in figures:
        files[OutputFile(folder / f"{figure.name}.png", png_signature("report"))] = figure.png
        files[OutputFile(folder / f"{figure.name}.svg", svg_signature("report"))] = figure.svg
    return files


def existing_plots(folder: Path) -> list[OutputFile]:
    """Files in ``folder`` and its folders for journals with names of a report's plots, whatever program wrote them."""
    signatures = {".png": png_signature("report"), ".svg": svg_signature("report")}
    files = [path for one in (folder, *sorted(folder.glob("*mm"))) for path in sorted(one.glob("*"))]
    plots = filter(lambda path: _FILE_NAMES.fullmatch(path.name), files)
    return [OutputFile(path, signatures[path.suffix]) for path in plots]


def pdf_output(folder: Path) -> OutputFile:
    """The page of ``folder`` as PDF."""
    return OutputFile(folder / "report.pdf", pdf_signature("report"))


def claim_page(folder: Path, plot: str, *, force: bool, protected: Iterable[Path]) -> OutputSet:
    """Permission to write a page and its plots into ``folder``.

    Raises OutputError if a file of another program has the name of one of the report's, or the folder cannot be
    written.
    """
    # The plots are not known yet; one stands for those that do not exist.
    first = OutputFile(folder / "plots" / f"{plot}.png", png_signature("report"))
    outputs = dict.fromkeys((OutputFile(folder / "index.html", PAGE), *existing_plots(folder / "plots"), first))
    return OutputSet(list(outputs), force=force, protected=protected)


def write_page(folder: Path, text: str, plots: Mapping[OutputFile, bytes], claim: OutputSet) -> Path:
    """Write ``folder``/index.html and its ``plots`` together, and remove those of an older page; return the page."""
    page = OutputFile(folder / "index.html", PAGE)
    older = [plot for plot in existing_plots(folder / "plots") if plot not in plots]
    stale = [plot.path for plot in older if plot.path.is_file() and plot.signature.matches(plot.path)]
    claim.write({**plots, page: text}, stale=stale)
    return page.path
