"""Signatures: byte patterns by which rovid recognises its own output files, and no foreign file by chance."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_HEAD_BYTES = 4096


@dataclass(frozen=True, kw_only=True)
class FileSignature:
    """How files of one kind are recognised."""

    description: str  #: The kind in a sentence, such as "a parameter file".
    pattern: re.Pattern[bytes]  #: Occurs near the beginning of each such file.
    #: Whether a file that matches may be replaced. A log or a rovid.toml belongs to the user once it is written: a
    #: match then only means that the same content might be there already.
    replaceable: bool = True
    head_bytes: int = _HEAD_BYTES  #: How many bytes of a file are searched; -1 for all.

    def matches(self, path: Path) -> bool:
        """Whether the file has this signature."""
        with path.open("rb") as stream:
            return self.pattern.search(stream.read(self.head_bytes)) is not None


def _signature(
    description: str, pattern: bytes, *, replaceable: bool = True, head_bytes: int = _HEAD_BYTES
) -> FileSignature:
    compiled = re.compile(pattern, re.MULTILINE | re.DOTALL)
    return FileSignature(description=description, pattern=compiled, replaceable=replaceable, head_bytes=head_bytes)


def export_mark(name: str) -> str:
    """Text that marks an export in the format ``name``."""
    return f"Written by rovid export {name}"


def export_signature(name: str) -> FileSignature:
    """Signature of an export in the format ``name``."""
    pattern = rb'"schema": "rovid-model/[0-9]' if name == "json" else re.escape(export_mark(name).encode()) + rb"[^\w-]"
    return _signature(f"an export for {name}", pattern)


def plot_mark(document: str) -> str:
    """Text that marks a picture or a printed page of a ``document``, such as "report"."""
    return f"rovid {document}"


def png_signature(document: str) -> FileSignature:
    """Signature of a PNG picture."""
    mark = re.escape(plot_mark(document).encode())
    return _signature(f"a picture of a {document}", rb"\A\x89PNG\r\n\x1a\n.*tEXtSoftware\x00" + mark)


def svg_signature(document: str) -> FileSignature:
    """Signature of an SVG picture."""
    mark = re.escape(plot_mark(document).encode())
    return _signature(f"a picture of a {document}", rb"\A<\?xml.*<dc:creator>.*<dc:title>" + mark + b"</dc:title>")


def pdf_signature(document: str) -> FileSignature:
    """Signature of a PDF page."""
    mark = re.escape(plot_mark(document).encode())
    return _signature(f"a {document} as PDF", rb"\A%PDF-.*/(Creator|Producer) \(" + mark + rb" *\)")


PARAMETERS = _signature("a parameter file", rb'^schema = "rovid-parameters/[0-9]+"\s*$')
HISTORY = _signature("a history of parameters", rb'\A\{"schema": "rovid-history/[0-9]+"')
PAGE = _signature("a page of rovid report", rb'^<meta name="generator" content="rovid [^"]*">$')
COMPARISON = _signature("a page of rovid compare", rb'^<meta name="generator" content="rovid compare [^"]*">$')
FLEET_PAGE = _signature("a page of rovid fleet", rb'^<meta name="generator" content="rovid-fleet [^"]*">$')
# Parquet stores its metadata at the end.
FLEET_TABLE = _signature("a table of rovid fleet", rb'\APAR1.*"schema": "rovid-fleet/[0-9]', head_bytes=-1)
CAMPAIGN = _signature("a campaign's diagnosis by rovid fleet", rb'\A\{\s*"schema": "rovid-campaign/[0-9]')
C_SOURCE = _signature("a controller in C", rb"\A/\* Heading controller, .{0,80} Written by rovid ")
PYTHON_SOURCE = _signature("a controller in Python", rb'\A"""Heading controller, .{0,80} Written by rovid ')
# rovid quotes the first name of the header, which CSV does not need, and leaves another without quotes. No other
# program writes CSV like this, and all can read it.
PLAN = _signature("a command file of rovid plan", rb'\A"time_s",([^\n]*,)?[^",\n]+(,[^\n]*)?\n')
EFFECT_FILE = _signature("an effect of rovid discover", rb'\A"""[^\n]*, found by rovid discover\. ')
# A new effect is the user's once it is written: no other file is like that.
NEW_EFFECT = _signature("a new effect", rb"\A\0rovid effect", replaceable=False)
CURVE = _signature("a thrust curve of rovid fit-thruster", rb'\A"command",thrust_N\n')
# An MCAP header without profile, with this library name.
RECORDING_LIBRARY = "rovid simulate"
RECORDING = _signature(
    "a recording of rovid simulate",
    rb"\A\x89MCAP0\r\n\x01.{8}\0{4}" + re.escape(len(RECORDING_LIBRARY).to_bytes(4, "little")) + b"rovid simulate",
)
LOG = _signature("this very log", rb"\A(time_s,|\x89MCAP0\r\n\x01.{8}\0{4}\x05\0{3}rovid|PAR1)", replaceable=False)
CONFIG = _signature("this very rovid.toml", rb"\A# Written by `rovid init`", replaceable=False)
GUESSED_CURVE = _signature("this very guessed curve", CURVE.pattern.pattern, replaceable=False)
