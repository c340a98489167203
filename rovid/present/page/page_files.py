"""What all pages share: templates, plots beside the page, and the print as PDF."""

from __future__ import annotations

import base64
import hashlib
import itertools
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import date
from html import unescape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup
from matplotlib.figure import Figure

from rovid.core.errors import NAME_LENGTH, ConfigError, OutputError, display_text, escape_invisible
from rovid.core.formatting import plus_minus
from rovid.core.output_files import PAGE, OutputFile, OutputSet, pdf_signature, plot_mark, png_signature, svg_signature
from rovid.present.console import bind_units
from rovid.present.number_format import as_sentence, equal_decimals, format_number, unit_symbol
from rovid.present.plots import canvas
from rovid.trial.assumptions import Assumptions

if TYPE_CHECKING:
    from jinja2 import Environment


# Programs on the PATH, and the usual places on macOS and Windows.
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_PLACES = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    r"C:\Program Files\Google\Chrome\Application\chrome.exe",
    r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
)
# Characters of a page that hold its title, and the name of the vehicle in it.
_HEAD, _TITLE = 4000, re.compile(r"<title>(.*): [^:<]*</title>")
_TIMEOUT = 180.0  # s; enough for a large page on a busy machine
# Entry of a PDF that names the program which made it; its text may contain escaped brackets.
_MADE_BY = re.compile(rb"/(Creator|Producer) \(((?:\\.|[^\\()])*)\)")


def template_environment(*packages: str) -> Environment:
    """An environment that looks for templates in ``packages``, then among those of the report."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    def escaped(value: object) -> object:
        # Markup is already escaped, and keeps its line ends.
        return escape_invisible(value) if isinstance(value, str) and not isinstance(value, Markup) else value

    environment = Environment(
        loader=ChoiceLoader(list(map(PackageLoader, (*packages, "rovid.present.page")))),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=escaped,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["bound"] = bind_units
    environment.filters["code"] = _with_code
    environment.filters["number"] = lambda value, form=".4g": format_number(value, form)
    environment.filters["prose"] = lambda text: _with_code(as_sentence(text))
    environment.filters["unit"] = unit_symbol
    environment.filters["plain"] = lambda value, digits=4: equal_decimals([value], digits)[0]
    environment.filters["short"] = lambda value: equal_decimals([value], 2)[0]
    environment.globals["plus_minus"] = plus_minus
    return environment


def _with_code(text: str) -> Markup:
    """``text`` with bound units, and its parts between backticks as code."""
    marks = itertools.cycle((Markup("{}"), Markup("<code>{}</code>")))
    parts = bind_units(escape_invisible(text)).split("`")
    return Markup("").join(mark.format(part) for mark, part in zip(marks, parts, strict=False))


def long_date(day: date) -> str:
    """A date in words: "7 March 2026"."""
    return f"{day:%d %B %Y}".lstrip("0")


@dataclass(frozen=True, kw_only=True)
class Assets:
    """Script and style that a page contains as they are."""

    script: Markup
    style: Markup

    @property
    def script_source(self) -> Markup:
        """The script's hash; with it a Content-Security-Policy permits this script and no other."""
        digest = hashlib.sha256(self.script.encode()).digest()
        return Markup("'sha256-{}'").format(base64.b64encode(digest).decode("ascii"))


def read_assets() -> Assets:
    """The plotting library with its licence, and the viewer's script."""
    folder = files("rovid.present.page") / "assets"
    names = ("uplot/LICENSE", "uplot/uPlot.iife.min.js", "uplot/uPlot.min.css", "viewer.js")
    licence, library, style, viewer = ((folder / name).read_text(encoding="utf-8") for name in names)
    # Files of this package, without any text from logs.
    script = Markup(f"/*\n{licence}*/\n{library}{viewer}")  # noqa: S704
    return Assets(script=script, style=Markup(style))  # noqa: S704


def require_browser() -> str:
    """The path of an installed browser. Raises ConfigError if there is none."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    found = found or next((place for place in _PLACES if Path(place).is_file()), None)
    if found is None:
        raise ConfigError(
            f"needs a browser; none of {', '.join(BROWSERS[:-1])} and {BROWSERS[-1]} was found.",
            where="--pdf",
            mend="Install one, or open the page in any browser and print it: the result is the same.",
        )
    return found


def print_pdf(page: Path, browser: str) -> bytes:
    """``page`` as PDF with rovid's mark. Raises OutputError if the browser made no PDF."""
    with tempfile.TemporaryDirectory(prefix="rovid", ignore_cleanup_errors=True) as name:
        made, profile = Path(name) / "page.pdf", Path(name) / "profile"
        command = [browser, "--headless=new", "--disable-gpu", "--no-pdf-header-footer", f"--user-data-dir={profile}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            # A browser does not run its sandbox as root; the page runs only its own script and fetches nothing.
            command.append("--no-sandbox")
        command += [f"--print-to-pdf={made}", page.resolve().as_uri()]
        try:
            done = subprocess.run(command, capture_output=True, check=False, timeout=_TIMEOUT)  # noqa: S603 - as found
        except (OSError, subprocess.TimeoutExpired) as error:
            raise _no_pdf(page, browser, str(error)) from error
        if not made.is_file():
            *_, last_line = ["no message", *done.stderr.decode(errors="replace").split("\n")]
            raise _no_pdf(page, browser, last_line)
        document = made.read_bytes()
        # Rovid's mark takes the place of the program's name, at the same length: a PDF has byte offsets.
        mark = plot_mark("report").encode()
        for found in _MADE_BY.finditer(document):
            if len(found[2]) >= len(mark):
                start, stop = found.span(2)
                return document[:start] + mark.ljust(stop - start) + document[stop:]
        return document


def _no_pdf(page: Path, browser: str, why: str) -> OutputError:
    return OutputError(f"{browser} printed no PDF of {page}: {why}. The page was written: print it from a browser.")


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


def require_same_vehicle(folder: Path, name: str) -> None:
    """Refuse to replace the report of another vehicle than ``name`` in ``folder``, with an OutputError."""
    page, name = folder / "index.html", escape_invisible(name)
    if not page.is_file() or not PAGE.matches(page):
        return
    with page.open(encoding="utf-8", errors="replace") as file:
        title = _TITLE.search(file.read(_HEAD))
    before = unescape(title[1]) if title else name
    if before != name:
        mend = f"On the command line, keep both with another folder, as -o {folder}_2, or replace it with --force."
        text = f"is the report of another vehicle, {display_text(before, NAME_LENGTH)!r}."
        raise OutputError(text, where=page, mend=mend)


def claim_page(
    folder: Path, plot: str, *, pdf: bool = False, force: bool = False, protected: Iterable[Path] = ()
) -> OutputSet:
    """Permission to write a page, and its print as ``pdf``, into ``folder``.

    Raises OutputError if a file cannot be written, or is another program's. Raises ConfigError if there is no browser
    to print with.
    """
    if pdf:
        require_browser()
    # The plots are not known yet; one stands for those that do not exist.
    first = OutputFile(folder / "plots" / f"{plot}.png", png_signature("report"))
    outputs = dict.fromkeys((OutputFile(folder / "index.html", PAGE), *existing_plots(folder / "plots"), first))
    return OutputSet([*outputs, *[pdf_output(folder)] * pdf], force=force, protected=protected)


def write_pdf(page: Path, claim: OutputSet) -> None:
    """Print ``page`` into the PDF of its folder."""
    claim.write({pdf_output(page.parent): print_pdf(page, require_browser())})


def write_page(folder: Path, text: str, plots: Mapping[OutputFile, bytes], claim: OutputSet) -> Path:
    """Write ``folder``/index.html and its ``plots`` together, and remove those of an older page; return the page."""
    page = OutputFile(folder / "index.html", PAGE)
    older = [plot for plot in existing_plots(folder / "plots") if plot not in plots]
    stale = [plot.path for plot in older if plot.path.is_file() and plot.signature.matches(plot.path)]
    claim.write({**plots, page: text}, stale=stale)
    return page.path
