"""What can go wrong that the user can mend: where, what was found, what was wanted, how to mend it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class RovidError(Exception):
    """Root of every error that the user can mend; the command line prints it and exits with 2.

    Parameters
    ----------
    message
        What was found and what was wanted.
    where
        File, line, column or topic; printed in front of the message.
    mend
        What to do about it; printed behind the message.
    """

    def __init__(self, message: str, *, where: object = "", mend: str = "") -> None:
        head = f"{where}: " if str(where) else ""
        tail = f" {mend}" if mend else ""
        super().__init__(f"{head}{message}{tail}")


class ConfigError(RovidError):
    """rovid.toml, a thrust curve or a command-line value is not what it should be."""


class LogError(RovidError):
    """A log cannot be read as what it claims to be."""


class DataError(RovidError):
    """The logs are readable but cannot answer the question that was asked."""


class OutputError(RovidError):
    """A result cannot be written."""


def nearest(wanted: str, present: Iterable[str]) -> str:
    """Sentence that offers the names nearest to ``wanted``, or all of them when none is near."""
    names = [str(name) for name in present]
    lowered = {name.lower(): name for name in names}
    close = difflib.get_close_matches(wanted.lower(), lowered, n=3, cutoff=0.5)
    if close:
        return "Nearest: " + ", ".join(repr(lowered[name]) for name in close) + "."
    if not names:
        return "There are none."
    shown = ", ".join(repr(name) for name in names[:12])
    return f"There are: {shown}{', …' if len(names) > 12 else ''}."
