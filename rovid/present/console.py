"""Text on a terminal: lines that end between words, and never between a number and its unit."""

import re
from collections.abc import Iterator, Sequence

from rich.cells import cell_len, chop_cells
from rich.console import Console
from rich.text import Text

from rovid.core.errors import LINE_LENGTH, display_text
from rovid.core.formatting import labelled_text
from rovid.trial.assumptions import Assumptions
from rovid.trial.fault import Fault, fault_texts

_NUMBER = r"[-+−(]*\d+(?:\.\d+)?(?:e[-+]\d+)?"
# First words of units that have several, such as kg m².
_UNIT_START = r"(?:kg|√?\(?N|m)\s+(?=[ms](?:\b|[²³^/)]))"
_WORD = re.compile(rf"(?:{_NUMBER}\s+(?:±\s+{_NUMBER}\s+)?(?![-+−(]*\d)(?:{_UNIT_START})*)?\S+\s*|\s+")
_BARE_WORD = re.compile(r"\S+\s*|\s+")
# Parts of a long name, which may be broken after punctuation.
_NAME_PART = re.compile(r"\s+|[^\s_./:,-]*[_./:,-]*")


# Kind of a verdict -> its style on a terminal; NO_COLOR leaves bold type.
VERDICT_STYLES = {"pass": "bold green", "warn": "bold yellow", "fail": "bold red"}


def bind_units(text: str) -> str:
    """``text`` with no-break spaces between numbers and their units, for a page that wraps lines itself."""
    return _WORD.sub(lambda word: re.sub(r"\s+(?=\S)", "\u00a0", word[0]), text)


def wrap_text(text: Text, width: int, indent: int = 0) -> Text:
    """``text`` in lines of at most ``width`` cells, all but the first indented.

    Lines end at blanks that do not precede a unit, else at any blank, else after punctuation, else anywhere.
    """
    if cell_len(text.plain) <= width:
        return text
    ends, used, position = [], 0, 0
    for piece in _pieces(text.plain, width - indent):
        if used and used + cell_len(piece.rstrip()) > width:
            ends.append(position)
            used = indent
        position += len(piece)
        used += cell_len(piece)
    lines = text.divide(ends)
    for line in lines:
        line.rstrip()
    return Text("\n" + " " * indent).join(lines)


def _pieces(text: str, width: int) -> Iterator[str]:
    """Words with the blanks after them; parts of words that are longer than ``width``."""

    def fits(word: str) -> bool:
        return cell_len(word.rstrip()) <= width

    for bound in _WORD.findall(text):
        for word in [bound] if fits(bound) else _BARE_WORD.findall(bound):
            if fits(word):
                yield word
                continue
            for part in filter(None, _NAME_PART.findall(word)):
                yield from chop_cells(part, width) if cell_len(part) > width else (part,)


def print_text(console: Console, text: str | Text, indent: int = 0) -> None:
    """Print a paragraph without colours for numbers; lines after the first are indented."""
    if isinstance(text, str):
        text = Text(display_text(text, LINE_LENGTH))
    console.print(wrap_text(text, console.width, indent), highlight=False)


def print_labelled(console: Console, label: str, text: str = "", style: str = "bold", indent: int = 0) -> None:
    """Print a paragraph with a label in the given style before it."""
    print_text(console, labelled_text(label, text, style), indent)


def print_path(console: Console, text: str) -> None:
    """Print a line with a path, which is never wrapped."""
    console.print(text, highlight=False, soft_wrap=True)


def show_warnings(console: Console, warnings: Sequence[str]) -> None:
    """Print each warning as its own paragraph."""
    for text in warnings:
        print_labelled(console, "Note:", text, "yellow")


def show_faults(console: Console, faults: Sequence[Fault]) -> None:
    """Print each fault of the logs with its remedy, those that stop a fit first."""
    for text in fault_texts(faults):
        print_labelled(console, "Logs:", text, "bold red" if any(fault.stops for fault in faults) else "bold yellow")


def show_caution(console: Console, guess: Assumptions) -> None:
    """Print the assumptions about the vehicle and their consequence."""
    if guess:
        first, _, rest = guess.caution.partition(". ")
        print_labelled(console, f"{first}.", rest, "bold red")
