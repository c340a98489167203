"""Errors that the user can correct: where, what was found, what was expected, and what to do."""

import difflib
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice
from types import MappingProxyType

# Characters of a message at most: place, finding and expectation, advice. 2000 in all.
_PLACE, _FOUND, _MEND = 490, 1000, 500
# Characters of a paragraph or of a table cell at most. No sentence of rovid is as long.
LINE_LENGTH = 2000
# Characters of one name at most; names offered and names searched at most.
NAME_LENGTH = 200
_OFFERED, _SEARCHED = 12, 10_000
# Unit at the end of a name.
_UNIT = re.compile(r"_(deg|rad|rad_s|deg_s|s|ms|us|m|m_s|n|nm|v|a|pct|percent|rpm)$")
# Unicode categories of characters that steer a terminal, change the direction of text or do not show: controls,
# formats, surrogates, line and paragraph separators, unassigned.
_INVISIBLE = {"Cc", "Cf", "Cs", "Zl", "Zp", "Cn"}
_JOINERS = "\u200c\u200d"  # zero width, and part of the spelling in many scripts


def is_visible(character: str) -> bool:
    """Whether a character shows as itself."""
    return character in _JOINERS or unicodedata.category(character) not in _INVISIBLE


def escape_invisible(
    text: str, escape: Callable[[str], str] = lambda one: one.encode("unicode_escape").decode()
) -> str:
    """``text`` with an ``escape``, by default as in `repr`, in place of each invisible character."""
    # Most texts need nothing, and looking at each character takes long.
    if text.isprintable():
        return text
    return "".join(one if is_visible(one) else escape(one) for one in text)


def display_text(text: object, length: int = NAME_LENGTH) -> str:
    """Text from a file (a name, a path, a cell) without invisible characters, the middle of a long one left out."""
    whole = str(text)
    if len(whole) <= 2 * length:
        escaped = escape_invisible(whole)
        if len(escaped) <= length:
            return escaped
    else:
        # Only the ends of a very long text are needed. An escape is longer than its character.
        escaped = escape_invisible(whole[:length]) + escape_invisible(whole[-length:])
    gap = f" … ({len(whole)} characters) … "
    kept = max(length - len(gap), 2)
    tail = kept // 2
    return escaped[: kept - tail] + gap + escaped[-tail:]


class RovidError(Exception):
    """Root of every error that the user can correct; the command line prints it and exits with 2.

    Quoted text appears as by `display_text`, and the whole message has less than 2000 characters.

    ``message``: What was found and what was expected.
    ``where``: File, line, column or topic; printed before the message.
    ``mend``: What the user can do; printed after the message.
    """

    def __init__(self, message: str, *, where: object = "", mend: str = "") -> None:
        head = f"{display_text(where, _PLACE)}: " if str(where) else ""
        tail = f" {display_text(mend, _MEND)}" if mend else ""
        super().__init__(f"{head}{display_text(message, _FOUND)}{tail}")


class ConfigError(RovidError):
    """rovid.toml, a thrust curve or a command-line value is invalid."""


class LogError(RovidError):
    """A log cannot be read in its format."""


class DataError(RovidError):
    """The logs are readable, but do not determine the requested result."""


class OutputError(RovidError):
    """A result cannot be written."""


def suggestion(wanted: str, present: Iterable[str], also: Mapping[str, str] = MappingProxyType({})) -> str:
    """Sentence with the `close_matches` of ``wanted``, or with all names ``present`` if there are none."""
    names = list(map(str, islice(present, _SEARCHED)))
    if close := close_matches(wanted, names, also):
        return f"Nearest: {quoted_list(close)}."
    if not names:
        return "There are none."
    more = ", …" if len(names) > _OFFERED else ""
    return f"There are: {quoted_list(names[:_OFFERED])}{more}."


def close_matches(
    wanted: str, present: Iterable[str], also: Mapping[str, str] = MappingProxyType({}), cutoff: float = 0.5
) -> list[str]:
    """Up to three of the names ``present`` that the user may mean by ``wanted``.

    These are names that contain ``wanted`` as a word (`lag` of `thruster_lag`), names with a synonym like it, names
    that it abbreviates (`hdg` for `heading`), and names with a similar spelling.

    ``also``: Synonym -> name.
    ``cutoff``: Least similarity of the spelling, 1 for the same.
    """
    # Only the beginnings are compared: the cost must not depend on the longest name of a file.
    names = {str(name)[:NAME_LENGTH].lower(): str(name) for name in islice(present, _SEARCHED)}
    asked = wanted[:NAME_LENGTH].lower()
    with_word = [name for name in names if asked in re.split(r"[\W_]+", name)]
    synonyms = [also[word].lower() for word in difflib.get_close_matches(asked, also, n=1, cutoff=0.8)]
    whole = _UNIT.sub("", asked)
    abbreviated = [
        name
        for name in names
        if _abbreviates(asked, name) or (_abbreviates(name, whole) and not whole.startswith(name))
    ]
    # A unit that two names share does not make them alike.
    bare = {_UNIT.sub("", name): name for name in reversed(names)}
    similar = [bare[name] for name in difflib.get_close_matches(whole, bare, n=3, cutoff=cutoff)]
    mistyped = difflib.get_close_matches(asked, names, n=1, cutoff=0.9)  # A letter too many is no abbreviation.
    found = (*with_word, *synonyms, *mistyped, *abbreviated, *similar)
    return [names[name] for name in dict.fromkeys(name for name in found if name in names)][:3]


def _abbreviates(letters: str, name: str) -> bool:
    """Whether ``name`` begins with the first of three ``letters`` or more, and contains all of them in this order."""
    rest = iter(name)
    return len(letters) > 2 and name[:1] == letters[:1] and all(letter in rest for letter in letters)


def quoted_list(names: Iterable[str]) -> str:
    """Names from files, each in quotes, separated by commas."""
    return ", ".join(f"'{display_text(name, NAME_LENGTH // 3)}'" for name in names)


def join_words(texts: Sequence[str], last: str = "and") -> str:
    """A list in words: "a, b and c", with ``last`` before the last item."""
    if len(texts) < 2:
        return "".join(texts)
    return f"{', '.join(texts[:-1])} {last} {texts[-1]}"


def shortened_list(names: Iterable[str], most: int = 5) -> str:
    """The first of ``names``, and the number of the others."""
    every = list(names)
    more = f" and {len(every) - most} more" if len(every) > most else ""
    return ", ".join(every[:most]) + more
