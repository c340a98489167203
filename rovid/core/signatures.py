"""How each kind of output is known again: by a mark in its first kilobytes that no foreign file has by chance."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_HEAD = 4096


@dataclass(frozen=True, kw_only=True)
class FileSignature:
    """A kind of output.

    Attributes
    ----------
    words
        What it is called in a sentence, as "a parameter file".
    mark
        Found in the beginning of each such file.
    replaced
        Whether a file with the mark may be replaced. A log or a rovid.toml is the user's as soon as it is written: the
        mark only says that the same might stand there already.
    reach
        How many bytes of a file the mark is looked for in; -1: all of them.
    """

    description: str
    pattern: re.Pattern[bytes]
    replaceable: bool = True
    reach: int = _HEAD

    def matches(self, path: Path) -> bool:
        """Whether the file bears the mark."""
        with path.open("rb") as stream:
            return self.pattern.search(stream.read(self.reach)) is not None


def _form(words: str, mark: bytes, *, replaced: bool = True, reach: int = _HEAD) -> FileSignature:
    return FileSignature(
        description=words, pattern=re.compile(mark, re.MULTILINE | re.DOTALL), replaceable=replaced, reach=reach
    )


def export_mark(name: str) -> str:
    """The words by which an export in the format ``name`` is known."""
    return f"Written by rovid export {name}"


def export_signature(name: str) -> FileSignature:
    """An export in the format ``name``."""
    mark = rb'"schema": "rovid-model/[0-9]' if name == "json" else re.escape(export_mark(name).encode()) + rb"[^\w-]"
    return _form(f"an export for {name}", mark)


def plot_mark(of: str) -> str:
    """The words by which a picture is known; ``of`` is what it belongs to."""
    return f"rovid {of}"


def png_signature(of: str) -> FileSignature:
    """A picture as PNG."""
    mark = re.escape(plot_mark(of).encode())
    return _form(f"a picture of a {of}", rb"\A\x89PNG\r\n\x1a\n.*tEXtSoftware\x00" + mark)


def svg_signature(of: str) -> FileSignature:
    """A picture as SVG."""
    mark = re.escape(plot_mark(of).encode())
    return _form(f"a picture of a {of}", rb"\A<\?xml.*<dc:creator>.*<dc:title>" + mark + b"</dc:title>")


def pdf_mark(of: str) -> str:
    """The words by which a printed page is known; ``of`` is what it belongs to."""
    return plot_mark(of)


def pdf_signature(of: str) -> FileSignature:
    """A page as PDF."""
    mark = re.escape(pdf_mark(of).encode())
    return _form(f"a {of} as PDF", rb"\A%PDF-.*/(Creator|Producer) \(" + mark + rb" *\)")


PARAMETERS = _form("a parameter file", rb'^schema = "rovid-parameters/[0-9]+"\s*$')
HISTORY = _form("a history of parameters", rb'\A\{"schema": "rovid-history/[0-9]+"')
PAGE = _form("a page of rovid report", rb'^<meta name="generator" content="rovid [^"]*">$')
COMPARISON = _form("a page of rovid compare", rb'^<meta name="generator" content="rovid compare [^"]*">$')
FLEET_PAGE = _form("a page of rovid fleet", rb'^<meta name="generator" content="rovid-fleet [^"]*">$')
# Parquet says at its end what it is.
FLEET_TABLE = _form("a table of rovid fleet", rb'\APAR1.*"schema": "rovid-fleet/[0-9]', reach=-1)
CAMPAIGN = _form("a campaign's diagnosis by rovid fleet", rb'\A\{\s*"schema": "rovid-campaign/[0-9]')
C_SOURCE = _form("a controller in C", rb"\A/\* Heading controller, .{0,80} Written by rovid ")
PYTHON_SOURCE = _form("a controller in Python", rb'\A"""Heading controller, .{0,80} Written by rovid ')
# The first name of the header is quoted, which it need not be, another is not: nobody else writes CSV so, all read it.
PLAN = _form("a command file of rovid plan", rb'\A"time_s",([^\n]*,)?[^",\n]+(,[^\n]*)?\n')
CURVE = _form("a thrust curve of rovid fit-thruster", rb'\A"command",thrust_N\n')
# A header without profile; its library is what mcap_bytes was told.
RECORDING_LIBRARY = "rovid simulate"
RECORDING = _form(
    "a recording of rovid simulate",
    rb"\A\x89MCAP0\r\n\x01.{8}\0{4}" + re.escape(len(RECORDING_LIBRARY).to_bytes(4, "little")) + b"rovid simulate",
)
LOG = _form("this very log", rb"\A(time_s,|\x89MCAP0\r\n\x01.{8}\0{4}\x05\0{3}rovid|PAR1)", replaced=False)
CONFIG = _form("this very rovid.toml", rb"\A# Written by `rovid init`", replaced=False)
GUESSED_CURVE = _form("this very guessed curve", CURVE.pattern.pattern, replaced=False)
