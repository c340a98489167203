"""Messages on the progress of a command, on standard error."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress(text: str) -> Iterator[Callable[[str], None]]:
    """Show a progress text, which the yielded function changes.

    Where standard error is no terminal, the text is printed every ten seconds; each one if ROVID_PROGRESS is "lines".
    """
    if os.environ.get("ROVID_PROGRESS") == "lines":
        _print_line(text)
        yield _print_line
        return
    if not sys.stderr.isatty():
        yield at_intervals(_print_line)
        return
    from rovid.core.console import SafeConsole

    screen = SafeConsole(stderr=True)
    with screen.status(text) as status:
        yield lambda words: status.update(screen.render_str(words))


def at_intervals(
    show: Callable[[str], None], seconds: float = 10.0, clock: Callable[[], float] = time.monotonic
) -> Callable[[str], None]:
    """Function that passes a text on to ``show`` if the last one, or the start, is so long ago."""
    last = clock()

    def show_if_due(text: str) -> None:
        nonlocal last
        if clock() - last >= seconds:
            last = clock()
            show(text)

    return show_if_due


def _print_line(text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
