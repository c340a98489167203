"""What can go wrong that the user can mend: where, what was found, what was wanted, how to mend it."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable, Mapping
from itertools import islice
from types import MappingProxyType

# Characters that a message gives to its place, to what was found and wanted, and to how to mend it: 2000 in all.
_PLACE, _FOUND, _MEND = 490, 1000, 500
# Of a paragraph or a cell of a table; no sentence of ours is as long.
LINE_LENGTH = 2000
# Of one name; and how many names are offered, and looked through.
NAME_LENGTH = 200
_OFFERED, _LOOKED_THROUGH = 12, 10_000
# They steer a terminal, turn the direction of text or are none at all: controls, formats, surrogates, line and
# paragraph separators, signs that no Unicode knows.
_UNSEEN = {"Cc", "Cf", "Cs", "Zl", "Zp", "Cn"}
_JOINERS = "\u200c\u200d"  # zero width, and part of many scripts' spelling


def is_visible(sign: str) -> bool:
    """Whether a character is seen for what it is."""
    return sign in _JOINERS or unicodedata.category(sign) not in _UNSEEN


def escape_invisible(text: str) -> str:
    """``text`` with everything that is not seen for what it is as an escape, as `repr` has it."""
    if text.isprintable():
        return text
    return "".join(map(_escaped, text))


def _escaped(sign: str) -> str:
    if is_visible(sign):
        return sign
    return sign.encode("unicode_escape").decode()


def display_text(text: object, length: int = NAME_LENGTH) -> str:
    """Text from elsewhere (a name, a path, a cell) as people are shown it: visible, its middle left out where long."""
    whole = str(text)
    if len(whole) <= 2 * length:
        seen = escape_invisible(whole)
        if len(seen) <= length:
            return seen
    else:
        # Only the ends of what is very long are looked at; an escape is longer than its sign.
        seen = escape_invisible(whole[:length]) + escape_invisible(whole[-length:])
    gap = f" … ({len(whole)} characters) … "
    kept = max(length - len(gap), 2)
    behind = kept // 2
    return seen[: kept - behind] + gap + seen[-behind:]


class RovidError(Exception):
    """Root of every error that the user can mend; the command line prints it and exits with 2.

    Whatever it quotes from a file is shown as `shown` does, and the whole stays below 2000 characters.

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
        head = f"{display_text(where, _PLACE)}: " if str(where) else ""
        tail = f" {display_text(mend, _MEND)}" if mend else ""
        super().__init__(f"{head}{display_text(message, _FOUND)}{tail}")


class ConfigError(RovidError):
    """rovid.toml, a thrust curve or a command-line value is not what it should be."""


class LogError(RovidError):
    """A log cannot be read as what it claims to be."""


class DataError(RovidError):
    """The logs are readable but cannot answer the question that was asked."""


class OutputError(RovidError):
    """A result cannot be written."""


def suggestion(wanted: str, present: Iterable[str], also: Mapping[str, str] = MappingProxyType({})) -> str:
    """Sentence that offers the names `near` to ``wanted``, or all of them when none is."""
    names = [str(name) for name in islice(present, _LOOKED_THROUGH)]
    if close := close_matches(wanted, names, also):
        return f"Nearest: {quoted_list(close)}."
    if not names:
        return "There are none."
    more = ", …" if len(names) > _OFFERED else ""
    return f"There are: {quoted_list(names[:_OFFERED])}{more}."


def close_matches(wanted: str, present: Iterable[str], also: Mapping[str, str] = MappingProxyType({})) -> list[str]:
    """The three names at most that may be meant by ``wanted``.

    Near is what is spelt nearly so, what has ``wanted`` as a part, as `lag` is of `thruster_lag`, or is cut down to it,
    as `heading` to `hdg`, and what goes by another word in ``also``: word -> name.
    """
    # Names are compared by their beginnings: what one thing costs must not depend on a file's longest name.
    names = {str(name)[:NAME_LENGTH].lower(): str(name) for name in islice(present, _LOOKED_THROUGH)}
    asked = wanted[:NAME_LENGTH].lower()
    parts = [name for name in names if asked in re.split(r"[\W_]+", name)]
    other = [also[word].lower() for word in difflib.get_close_matches(asked, also, n=1, cutoff=0.8)]
    cut = [name for name in names if len(asked) > 2 and name[:1] == asked[:1] and _runs_through(asked, name)]
    spelt = difflib.get_close_matches(asked, names, n=3, cutoff=0.5)
    close = dict.fromkeys(name for name in (*parts, *other, *cut, *spelt) if name in names)
    return [names[name] for name in close][:3]


def _runs_through(letters: str, name: str) -> bool:
    """Whether ``name`` has all the ``letters``, in that order."""
    left = iter(name)
    return all(letter in left for letter in letters)


def quoted_list(names: Iterable[str]) -> str:
    """Names from elsewhere, each in quotes."""
    return ", ".join(f"'{display_text(name, NAME_LENGTH // 3)}'" for name in names)
