"""Lines that end between words, and never between a number and its unit."""

from __future__ import annotations

import re
from collections.abc import Iterator

from rich.cells import cell_len, chop_cells
from rich.text import Text

_NUMBER = r"[-+−(]*\d+(?:\.\d+)?(?:e[-+]\d+)?"
# What begins a unit of several words, where the next goes on with it.
_BEGUN = r"(?:kg|√?\(?N|m)\s+(?=[ms](?:\b|[²³^/)]))"
_WORD = re.compile(rf"(?:{_NUMBER}\s+(?:±\s+{_NUMBER}\s+)?(?![-+−(]*\d)(?:{_BEGUN})*)?\S+\s*|\s+")
_BARE = re.compile(r"\S+\s*|\s+")
# Where a name may be folded besides at its blanks.
_PIECE = re.compile(r"\s+|[^\s_./:,-]*[_./:,-]*")


def bind_units(text: str) -> str:
    """``text`` for a page that folds it itself: numbers hold on to their units."""
    return _WORD.sub(lambda word: re.sub(r"\s+(?=\S)", "\u00a0", word[0]), text)


def wrap_text(text: Text, width: int, hang: int = 0) -> Text:
    """``text`` in lines of that width, all but the first ``hang`` blanks in.

    They end at blanks that do not stand before a unit; else at any, or behind a sign within a name; else anywhere.
    """
    if cell_len(text.plain) <= width:
        return text
    ends, used, at = [], 0, 0
    for piece in _pieces(text.plain, width - hang):
        if used and used + cell_len(piece.rstrip()) > width:
            ends.append(at)
            used = hang
        at += len(piece)
        used += cell_len(piece)
    lines = text.divide(ends)
    for line in lines:
        line.rstrip()
    return Text("\n" + " " * hang).join(lines)


def _pieces(text: str, width: int) -> Iterator[str]:
    """Words with the blanks behind them; parts of words that are longer than a line."""
    for bound in _WORD.findall(text):
        for word in [bound] if _fits(bound, width) else _BARE.findall(bound):
            if _fits(word, width):
                yield word
                continue
            for piece in filter(None, _PIECE.findall(word)):
                yield from chop_cells(piece, width) if cell_len(piece) > width else (piece,)


def _fits(word: str, width: int) -> bool:
    return cell_len(word.rstrip()) <= width
