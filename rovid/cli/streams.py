"""Surroundings of a run: standard streams, progress, width of the terminal, working folder, errors of the machine."""

from __future__ import annotations

import codecs
import contextlib
import errno
import math
import os
import sys
import threading
import time
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING

from rovid.core.budget import SECONDS_PER_HOUR
from rovid.core.errors import display_text

# Characters without a decomposition into ASCII -> their spelling in ASCII.
_SPELLINGS = {"±": "+-", "–": "-", "—": "-", "−": "-", "·": "*", "×": "x", "√": "sqrt ", "∮": "integral ", "≥": ">="}
_SPELLINGS |= {"≤": "<=", "≈": "~", "─": "-", "→": "->", "∞": "inf", "°": " deg", "’": "'", **dict.fromkeys("„“”", '"')}
# Parts of the message of an import, of the system and of a thread for which there is no memory.
_NO_MEMORY = ("failed to map segment", os.strerror(errno.ENOMEM), "can't start new thread")
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
    spelled = []
    for character in error.object[error.start : error.end]:
        plain, name = unicodedata.normalize("NFKD", character), unicodedata.name(character, "")
        plain = _SPELLINGS.get(character) or plain.encode("ascii", "ignore").decode()
        if not plain and name.startswith("GREEK"):
            plain = name.rpartition(" ")[2].lower()
        spelled.append(plain or character.encode("ascii", "backslashreplace").decode())
    return "".join(spelled), error.end


def machine_error(error: Exception) -> str:
    """Message on an error of the machine that no user's input causes; empty for any other error."""
    if isinstance(error, MemoryError) or any(sign in str(error) for sign in _NO_MEMORY):
        text = "there is not enough memory. rovid needs about 1 GB, and more for many hours of logs. Close other "
        return f"{text}programs, raise the limit (ulimit -v, or that of the container), or give fewer or shorter logs."
    if not isinstance(error, OSError):
        return ""
    if error.errno == errno.ENAMETOOLONG:
        return f"{display_text(error.filename)}: there is no such file or folder, because the name is too long."
    if error.errno in _OUTPUT_ERRORS and error.filename is None:
        return f"the output cannot be written: {error.strerror}. Free some space, or write it elsewhere."
    has_working_folder = False
    with contextlib.suppress(FileNotFoundError):
        has_working_folder = Path.cwd().exists()
    if isinstance(error, FileNotFoundError) and not has_working_folder:
        return "the working folder does not exist any more. Change to another folder."
    return ""


if TYPE_CHECKING:
    from rich.text import Text

# s: between two lines where standard error is no terminal, and until the first line of a step that is known to take
# long, and of reading, which is short otherwise.
_INTERVAL, SOON = 10.0, 2.0


@dataclass(eq=False)
class Progress:
    """What a command is doing, and for how long."""

    text: str
    limit: float = math.inf  # Time allowed in s
    clock: Callable[[], float] = time.monotonic
    _began: float = field(init=False)

    def __post_init__(self) -> None:
        """Start the clock."""
        self._began = self.clock()

    def set(self, text: str) -> None:
        """Change what the command is doing."""
        self.text = text

    def __str__(self) -> str:
        """The text with the time so far, and the time allowed as long as it lasts: the step at hand is completed."""
        used = self.clock() - self._began
        at_most = f" of at most {self.limit:.0f}" if used <= self.limit < math.inf else ""
        return f"{self.text} ({used:.0f}{at_most} s)"

    def __rich__(self) -> Text:
        """The same for a terminal, which asks anew for each picture."""
        from rich.text import Text

        from rovid.core.errors import LINE_LENGTH, display_text

        return Text(display_text(str(self), LINE_LENGTH))


# What the commands show; steps may be nested.
_shown: list[Progress] = []


@contextmanager
def progress(text: str, limit: float = math.inf, first: float = _INTERVAL) -> Iterator[Callable[[str], None]]:
    """Show a progress text, which the yielded function changes, with the time so far and the time allowed in s.

    Where standard error is no terminal, a line is printed after ``first`` s and then every ten seconds; each text is
    a line if ROVID_PROGRESS is "lines", and none if it is "none". Inside another progress the texts are shown there.
    """
    if os.environ.get("ROVID_PROGRESS") == "none":
        yield lambda _: None
        return
    if os.environ.get("ROVID_PROGRESS") == "lines":
        _print_line(text)
        yield _print_line
        return
    if _shown:
        _shown[-1].set(text)
        yield _shown[-1].set
        return
    from rovid.core.formatting import SafeConsole

    is_long = SECONDS_PER_HOUR < limit < math.inf
    _shown.append(shown := Progress(text, limit))
    lines = lines_at_intervals(shown, SOON if is_long else first)
    try:
        with SafeConsole(stderr=True).status(shown) if sys.stderr.isatty() else lines:
            yield shown.set
    finally:
        _shown.remove(shown)


@contextmanager
def lines_at_intervals(shown: Progress, first: float, interval: float = _INTERVAL) -> Iterator[None]:
    """Print ``shown`` after ``first`` s and then every ``interval`` s, whatever the block does."""
    over = threading.Event()

    def print_lines() -> None:
        wait = first
        while not over.wait(wait):
            _print_line(str(shown))
            wait = interval

    thread = threading.Thread(target=print_lines, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _print_line(text: str) -> None:
    # A closed or full standard error must not end the command.
    with contextlib.suppress(OSError, ValueError):
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()
