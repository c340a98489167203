"""Palette, style, grids of panels, decimation and reproducible rendering of all figures."""

import contextlib
import functools
import io
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from itertools import chain
from typing import Any, ParamSpec, TypeVar

import numpy as np
from markupsafe import Markup
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import escape_invisible
from rovid.core.output_files import plot_mark
from rovid.trial.assumptions import Assumptions

# Palette of Okabe and Ito for every kind of colour vision; markers and dashes distinguish the lines too.
BLACK, BLUE, ORANGE, GREEN, GREY, PALE = "#111111", "#0072B2", "#D55E00", "#009E73", "#767676", "#8CBFE6"
RED = "#B3001B"
STYLE: dict[str, Any] = {
    "axes.edgecolor": "#444444",
    "axes.formatter.limits": (-4, 5),
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "date.converter": "concise",
    "figure.dpi": 130,
    "figure.facecolor": "white",
    "font.size": 10,
    "grid.color": "#e2e2e2",
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "lines.linewidth": 1.4,
    "svg.hashsalt": "rovid",
    "text.parse_math": False,  # a log may have the name run$1$.csv
}
WIDTH = 9.0  # in
_COLOURS, _NEARLY_WHITE = 192, 251
# Colour -> variable of the page's style.
_VARIABLES = {
    BLACK: "simulated",
    ORANGE: "without",
    PALE: "measured",
    RED: "alarm",
    "#000000": "soft",
    "#444444": "soft",
    "#e2e2e2": "line",
}
POINTS = 1200
# Pixels per inch of a PNG for a journal, and mm per inch.
_JOURNAL_DPI, _INCH = 300.0, 25.4
# Size in print relative to the drawing: text of 10 points has 8.
_IN_PRINT = 0.8
# in; panels of a narrower figure stand one below another, and its legends stand above the titles, not beside them.
_ONE_COLUMN, _LEGEND = 5.5, 0.25
# in; around all that is drawn in a figure for a journal.
_PADDING = 0.03
_journal: ContextVar[float | None] = ContextVar("journal", default=None)

P = ParamSpec("P")
R = TypeVar("R")


def report_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Run ``draw`` with the report's style instead of the user's matplotlibrc."""

    @functools.wraps(draw)
    def under_style(*args: P.args, **kwargs: P.kwargs) -> R:
        with style.context(["default", STYLE]):
            return draw(*args, **kwargs)

    return under_style


@contextlib.contextmanager
def journal_plots(width: str) -> Iterator[None]:
    """Draw and render figures of a ``width`` in print, as "84mm"."""
    token = _journal.set(float(width.removesuffix("mm")))
    try:
        yield
    finally:
        _journal.reset(token)


def panel_grid(
    rows: Sequence[tuple[float, int]],
    *,
    left: float = 0.9,
    right: float = 0.15,
    top: float = 0.35,
    bottom: float = 0.55,
    across: float = 0.85,
    down: float = 0.75,
    share_x: bool = False,
    width: float = WIDTH,
    stacked: float | None = None,
) -> tuple[Figure, list[list[Axes]]]:
    """A figure with rows of panels.

    Margins are fixed, so that axes of successive figures align, and no layout has to be computed.

    ``rows``: Height in inches and number of panels of each row.
    ``left``, ``right``, ``top``, ``bottom``: Margins in inches.
    ``across``, ``down``: Gaps between panels in inches.
    ``share_x``: One horizontal axis for all rows, labelled in the last.
    ``width``: Of the figure in inches; less in a narrow journal, whose panels stand one below another.
    ``stacked``: Gap between these panels; by default a wide one, with room for legends.
    """
    journal = _journal.get()
    if journal is not None:
        width = min(width, journal / _INCH / _IN_PRINT)
    if width < _ONE_COLUMN and any(count > 1 for _, count in rows):
        single = [(tall, 1) for tall, count in rows for _ in range(count)]
        gap = max(down, 0.75) + 0.3 if stacked is None else stacked
        margins = {"left": left, "right": right, "top": top, "bottom": bottom, "down": gap}
        figure, column = panel_grid(single, share_x=share_x, width=width, **margins)
        each = iter(row[0] for row in column)
        return figure, [[next(each) for _ in range(count)] for _, count in rows]
    if journal is not None and width < _ONE_COLUMN:
        left, top = min(left, 0.4 * width), top + _LEGEND
    height = top + sum(tall for tall, _ in rows) + down * (len(rows) - 1) + bottom
    figure = Figure(figsize=(width, height))
    panels: list[list[Axes]] = []
    floor = height - top
    for tall, count in rows:
        floor -= tall
        wide = (width - left - right - across * (count - 1)) / count
        first = panels[0][0] if share_x and panels else None
        lefts = [left + k * (wide + across) for k in range(count)]
        boxes = [(x / width, floor / height, wide / width, tall / height) for x in lefts]
        panels.append([figure.add_axes(box, sharex=first) for box in boxes])
        floor -= down
    if share_x:
        for row in panels[:-1]:
            row[0].tick_params(labelbottom=False)
    return figure, panels


def panel_sheet(count: int, columns: int, height: float, **margins: Any) -> tuple[Figure, list[Axes]]:
    """A figure with ``count`` panels of a ``height`` in inches, in rows of ``columns``; see `panel_grid`."""
    figure, rows = panel_grid([(height, columns)] * -(-count // columns), stacked=margins.get("down"), **margins)
    panels = list(chain(*rows))
    for panel in panels[count:]:
        panel.set_axis_off()
    return figure, panels[:count]


def legend_above(figure: Figure, handles: Sequence[Any], labels: Sequence[str], columns: int, **where: Any) -> None:
    """A legend above all panels, at the upper right or at ``where``; in a narrow journal with fewer columns."""
    place: dict[str, Any] = {"loc": "upper right", "borderaxespad": 0.1} | where
    legend = figure.legend(handles, labels, ncols=columns, **place)
    if _journal.get() is None:
        return
    while columns > 1 and legend.get_window_extent().width > figure.bbox.width:
        columns -= 1
        legend.remove()
        legend = figure.legend(handles, labels, ncols=columns, **place)
    drawn = [box for panel in figure.axes if (box := panel.get_tightbbox()) is not None]
    overlap = (max(box.y1 for box in drawn) - legend.get_window_extent().y0) / figure.dpi
    if overlap > 0.0:
        # The figure grows by the rows of the legend; the panels keep their sizes.
        width, height = figure.get_size_inches()
        figure.set_size_inches(width, height + overlap)
        for panel in figure.axes:
            x, y, wide, tall = panel.get_position().bounds
            share = height / (height + overlap)
            panel.set_position((x, y * share, wide, tall * share))


@report_style
def mark_guessed(figure: Figure, guess: Assumptions) -> Figure:
    """``figure``, with the assumptions along its edge where the unit of an axis depends on them."""
    labels = [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel())]
    units = [label.rpartition(",")[2].strip() for label in labels]
    if any(map(guess.is_placeholder, units)):
        # The right margin of every figure is narrow and empty.
        words = f"by guessed {guess.quantities}"
        figure.text(0.999, 0.5, words, color=RED, size=8, rotation=90, ha="right", va="center")
    return figure


@report_style
def render_png(figure: Figure, of: str = "report") -> bytes:
    """The figure as PNG with a palette, a third of the size of full colour; ``of`` is the kind of document."""
    journal = _journal.get()
    canvas: Any = FigureCanvasAgg(figure)  # its methods carry no annotations
    with warnings.catch_warnings():
        _accept_any_name(figure)
        canvas.draw()
        if journal is None:
            drawn = Image.fromarray(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3]))
        else:
            box, pixels = figure.get_tightbbox(canvas.get_renderer()).padded(_PADDING), io.BytesIO()
            figure.savefig(pixels, bbox_inches=box, dpi=_JOURNAL_DPI * journal / _INCH / box.width)
            drawn = Image.open(pixels).convert("RGB")
    image = drawn.quantize(_COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    # The octree quantiser darkens white slightly, which is visible on the white page.
    image.putpalette([255 if level > _NEARLY_WHITE else level for level in image.getpalette() or ()])
    buffer = io.BytesIO()
    text = PngInfo()
    text.add_text("Software", plot_mark(of))
    image.save(buffer, format="png", pnginfo=text, **({} if journal is None else {"dpi": (_JOURNAL_DPI, _JOURNAL_DPI)}))
    return buffer.getvalue()


@report_style
def render_svg(figure: Figure) -> bytes:
    """The figure as SVG, text as text, without date: the same data give the same bytes."""
    buffer = io.BytesIO()
    canvas: Any = FigureCanvasSVG(figure)  # its methods carry no annotations
    with warnings.catch_warnings(), style.context({"svg.fonttype": "none"}):
        _accept_any_name(figure)
        metadata = {"Date": None, "Creator": plot_mark("report")}
        if (journal := _journal.get()) is None:
            canvas.print_svg(buffer, metadata=metadata)
            return buffer.getvalue()
        figure.savefig(buffer, format="svg", bbox_inches="tight", pad_inches=_PADDING, metadata=metadata)
    wide, high = map(float, re.findall(rb'(?:width|height)="([\d.]+)pt"', buffer.getvalue())[:2])
    size = f'width="{journal:g}mm" height="{journal * high / wide:.2f}mm"'.encode()
    return re.sub(rb'width="[\d.]+pt" height="[\d.]+pt"', size, buffer.getvalue(), count=1)


@report_style
def render_inline_svg(figure: Figure, name: str) -> Markup:
    """The figure as SVG inside a page: text as text, colours of the page's style, light or dark.

    ``name`` makes the identifiers unique within the page.
    """
    buffer = io.BytesIO()
    figure.set_facecolor("none")
    for panel in figure.axes:
        panel.set_facecolor("none")
    canvas: Any = FigureCanvasSVG(figure)  # its methods carry no annotations
    with warnings.catch_warnings(), style.context({"svg.fonttype": "none", "svg.hashsalt": name}):
        _accept_any_name(figure)
        canvas.print_svg(buffer, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    text = buffer.getvalue().decode()
    text = text[text.index("<svg") :]
    # A style element would apply to the whole page. Clipping is not needed. Only tick marks are referred to by id.
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)
    text = re.sub(r' clip-path="[^"]*"', "", text)
    used = set(re.findall(r'href="#([^"]*)"', text))
    text = re.sub(r' id="([^"]*)"', lambda found: f' id="{name}-{found[1]}"' if found[1] in used else "", text)
    text = text.replace('href="#', f'href="#{name}-')
    for colour, variable in _VARIABLES.items():
        text = re.sub(colour, f"var(--{variable})", text, flags=re.IGNORECASE)
    text = re.sub(r"font: ([\w. ]+px) [^;\"]*", r"font: \1 system-ui, sans-serif", text)
    # Matplotlib gives black text no colour.
    text = text.replace("<text ", '<text fill="currentColor" ')
    return Markup(text)  # noqa: S704 - matplotlib escapes what a log may hold


def _accept_any_name(figure: Figure) -> None:
    """Escape invisible characters, which names of logs and thrusters may contain, and which SVG forbids."""
    for text in _texts(figure):
        text.set_text("\n".join(map(escape_invisible, text.get_text().split("\n"))))
    # A box replaces each character that the font lacks.
    warnings.filterwarnings("ignore", message=r"Glyph \d+")


def _texts(artist: Artist) -> Iterator[Text]:
    """All texts in ``artist`` except those of ticks, which matplotlib recreates for every drawing."""
    if isinstance(artist, Text):
        yield artist
    elif isinstance(artist, Axis):
        yield artist.label
    else:
        for child in artist.get_children():
            yield from _texts(child)


def plot_overlay(
    panel: Axes, time: FloatArray, measured: FloatArray, simulated: FloatArray, count: int = POINTS
) -> None:
    """Plot a thin dark simulation over a broad pale measurement: both are visible where they agree."""
    panel.plot(*decimate_min_max(time, measured, count), color=PALE, linewidth=3.6, label="measured")
    panel.plot(*decimate_min_max(time, simulated, count), color=BLACK, linewidth=1.1, label="simulated")


def decimate_min_max(time: FloatArray, values: FloatArray, count: int = POINTS) -> tuple[FloatArray, FloatArray]:
    """At most about ``count`` points of a long series, with the lowest and highest of each stretch.

    A stretch without values gives NaN, so gaps remain visible.
    """
    size = -(-2 * len(values) // count)
    if size <= 2:
        return time, values
    rows = min_max_indices(values, size)
    return time[rows], values[rows]


def min_max_indices(values: FloatArray, size: int) -> IntArray:
    """Indices of lowest and highest value in each stretch of ``size`` samples; of its first sample if all are NaN."""
    padding = -len(values) % size
    blocks = np.pad(values, (0, padding), constant_values=np.nan).reshape(-1, size)
    missing = np.isnan(blocks)
    lowest = np.where(missing, np.inf, blocks).argmin(axis=1)
    highest = np.where(missing, -np.inf, blocks).argmax(axis=1)
    pick = np.sort(np.stack((lowest, highest), axis=1), axis=1)
    return np.asarray((pick + size * np.arange(len(blocks))[:, None]).ravel())
