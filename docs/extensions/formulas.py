"""Formulas as SVG drawings that look the same in every browser, without scripts, fonts or network.

MathML would need no drawing, but without a mathematics font browsers lose the dot of a derivative.
"""

from __future__ import annotations

import html
from functools import cache

from docutils import nodes
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextToPath
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.typing import ExtensionMetadata
from sphinx.writers.html5 import HTML5Translator

from rovid.core.array_types import FloatArray

_SIZE = 100.0  # drawing units in 1 em
_LETTERS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C", Path.CLOSEPOLY: "Z"}
# STIX letters are slightly smaller than the letters of the text.
_EM = 1.1


@cache
def drawing(formula: str, *, display: bool) -> str:
    """``formula`` as an SVG in the colour of the text and on its baseline."""
    text = f"${formula.replace(chr(10), ' ')}$"
    if display:
        text = text.replace(r"\frac", r"\dfrac")
    # At 72 dots per inch a size in points equals a size in dots.
    font = FontProperties(size=_SIZE, math_fontfamily="stix")
    maker = TextToPath()
    width, height, depth = maker.get_text_width_height_descent(text, font, ismath=True)
    vertices, codes = maker.get_text_path(font, text, ismath=True)
    scale = _SIZE / maker.FONT_SCALE
    outline = "".join(
        _LETTERS[code] + ("" if code == Path.CLOSEPOLY else _numbers(scale * points))
        for points, code in Path(vertices, codes).iter_segments(simplify=False)
    )
    em = _EM / _SIZE
    return (
        f'<svg class="formula" role="img" aria-label="{html.escape(formula)}" '
        f'viewBox="0 {depth - height:.0f} {width:.0f} {height:.0f}" '
        f'style="width:{width * em:.2f}em;height:{height * em:.2f}em;vertical-align:{-depth * em:.2f}em">'
        f'<path fill="currentColor" d="{outline}"/></svg>'
    )


def _numbers(points: FloatArray) -> str:
    """Pairs of coordinates, with the y axis of SVG downwards."""
    return " ".join(f"{x:.0f} {-y:.0f}" for x, y in points.reshape(-1, 2))


def _drawn(node: nodes.Element, *, display: bool) -> str:
    try:
        return drawing(node.astext(), display=display)
    except ValueError as error:
        message = f"{node.source}:{node.line}: {error}"
        raise ExtensionError(message) from error


def _inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(_drawn(node, display=False))
    raise nodes.SkipNode


def _display(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="formulas">{_drawn(node, display=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> ExtensionMetadata:
    """Register the renderer as ``drawn``."""
    app.add_html_math_renderer("drawn", (_inline, None), (_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
