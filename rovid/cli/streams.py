"""Surroundings of a run: the standard streams, the terminal's width, the working folder, and errors of the machine."""

from __future__ import annotations

import codecs
import errno
import os
import sys
import unicodedata
from io import TextIOWrapper
from pathlib import Path

from rovid.core.errors import display_text

# Characters without a decomposition into ASCII -> their spelling in ASCII.
_SPELLINGS = {"±": "+-", "–": "-", "—": "-", "−": "-", "·": "*", "×": "x", "√": "sqrt ", "∮": "integral ", "≥": ">="}
_SPELLINGS |= {
    "≤": "<=",
    "≈": "~",
    "─": "-",
    "→": "->",
    "∞": "inf",
    "°": " deg",
    "„": '"',
    "“": '"',
    "”": '"',
    "’": "'",
}
# Errors of the output's device: no space, quota, fault of the device, closed stream.
_OUTPUT_ERRORS = {errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EBADF}


def prepare_streams() -> None:
    """Replace closed standard streams, spell what their encoding lacks, and ignore an impossible width."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("r+", encoding="utf-8"))  # noqa: SIM115 - open as long as the process
    codecs.register_error("rovid.spelling", _spelling)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="rovid.spelling")
    if not os.environ.get("COLUMNS", "").isdigit() or int(os.environ["COLUMNS"]) < 1:
        os.environ.pop("COLUMNS", None)


def _spelling(error: UnicodeError) -> tuple[str, int]:
    """Spelling of characters that the encoding lacks: 2 for ², tau for τ, else an escape."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_spelled, error.object[error.start : error.end])), error.end


def _spelled(character: str) -> str:
    if character in _SPELLINGS:
        return _SPELLINGS[character]
    plain = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    name = unicodedata.name(character, "")
    if not plain and name.startswith("GREEK"):
        plain = name.rpartition(" ")[2].lower()
    return plain or character.encode("ascii", "backslashreplace").decode()


def machine_error(error: OSError | MemoryError) -> str:
    """Message on an error of the machine that no user's input causes; empty for any other error."""
    if isinstance(error, MemoryError):
        return "there is not enough memory. Give fewer or shorter logs, or close other programs."
    if error.errno == errno.ENAMETOOLONG:
        return f"{display_text(error.filename)}: there is no such file or folder, because the name is too long."
    if error.errno == errno.ENOMEM:
        return machine_error(MemoryError())
    if error.errno in _OUTPUT_ERRORS and error.filename is None:
        return f"the output cannot be written: {error.strerror}. Free some space, or write it elsewhere."
    if isinstance(error, FileNotFoundError) and not _has_working_folder():
        return "the working folder does not exist any more. Change to another folder."
    return ""


def _has_working_folder() -> bool:
    try:
        return Path.cwd().exists()
    except FileNotFoundError:
        return False
