"""The pages of the documentation that `rovid help TOPIC` prints.

They are those of docs/, which an installed rovid brings with it; nothing of them is written twice.
"""

from __future__ import annotations

import re
from pathlib import Path

import rovid
from rovid.core.errors import ConfigError, suggestion
from rovid.export import ALIASES as FORMAT_WORDS
from rovid.export import FORMATS

# In the order in which they are listed; the effects follow.
TOPICS = (
    "own_logs",
    "logs",
    "files",
    "axes",
    "fit",
    "diagnose",
    "compare",
    "plan",
    "watch",
    "control",
    "export",
    "report",
    "open",
    "fleet",
    "confusion",
    "hard",
    "troubleshooting",
    "glossary",
    "effects",
)
_INDEX = "README"
_PACKAGE = Path(rovid.__file__).parent
# What people look for -> the topic that tells of it.
_ALSO = {
    **dict.fromkeys((*FORMATS, *FORMAT_WORDS), "export"),
    **dict.fromkeys(("surge", "sway", "heave", "roll", "pitch", "yaw", "axis"), "axes"),
    **dict.fromkeys(("rovid.toml", "json", "parameters", "toml", "configuration"), "files"),
    **dict.fromkeys(("formats", "csv", "mcap", "parquet", "ulog", "bag", "dataflash", "nmea", "convert"), "logs"),
    **dict.fromkeys(("begin", "start", "tutorial", "init", "check"), "own_logs"),
    **dict.fromkeys(("app", "browser", "gui", "server"), "open"),
    **dict.fromkeys(("drag", "inertia", "fit-drag", "fit-inertia"), "fit"),
    **dict.fromkeys(("history", "refit", "before", "payload", "fouling"), "compare"),
}
_COMMENT = re.compile(r"<!--.*?-->\n*", re.DOTALL)
# A picture and what tells how it was drawn.
_PICTURE = re.compile(r"^\[?!\[[^\n]*\n+(?:Step: .*?\n\n)?", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\[([^\]]+)\]\(([^)\s]+)\)")


def topic_names() -> list[str]:
    """Every topic: the pages, then the effects by their ids."""
    effects = sorted(page.stem for page in (_folder() / "effects").glob("*.md") if page.stem != _INDEX)
    return [*TOPICS, *effects]


def topic_title(topic: str) -> str:
    """The heading of a page."""
    return next(line[2:] for line in topic_text(topic).splitlines() if line.startswith("# "))


def topic_text(topic: str) -> str:
    """The page as Markdown, for reading where there are neither pictures nor links.

    Raises
    ------
    ConfigError
        There is none; the nearest are offered.
    """
    there = topic_names()
    if topic not in there:
        also = _ALSO | _effect_words()
        raise ConfigError(
            f"there is no page {topic!r}. {suggestion(topic, there, also)}", mend="`rovid help` lists them all."
        )
    page = _COMMENT.sub("", _path(topic).read_text(encoding="utf-8"))
    page = _LINK.sub(lambda link: _reference(link, topic), _PICTURE.sub("", page))
    if "sample_logs/" in page:
        page += "\nThe sample logs come with rovid's sources.\n"
    return page


def _effect_words() -> dict[str, str]:
    # The catalogue is slow to import: only where a name was not found.
    from rovid.effects import SYNONYMS

    return dict(SYNONYMS)


def _folder() -> Path:
    """Where the pages are: in an installed rovid beside its code, in a checkout in docs/."""
    installed = _PACKAGE / "pages"
    return installed if installed.is_dir() else _PACKAGE.parent / "docs"


def _path(topic: str) -> Path:
    if topic == "effects":
        return _folder() / "effects" / f"{_INDEX}.md"
    page = _folder() / f"{topic}.md"
    return page if topic in TOPICS else _folder() / "effects" / page.name


def _reference(link: re.Match[str], topic: str) -> str:
    """A link as words, and where it leads if that can be read."""
    words, target = link.groups()
    if target.startswith("http"):
        return f"{words} ({target})"
    page = Path(target.partition("#")[0])
    name = "effects" if page.stem == _INDEX else page.stem
    if page.suffix != ".md" or name in {topic, words} or name not in {*topic_names()}:
        return words
    # An effect that is named goes by nearly the same name.
    return words if words.replace(" ", "_") == name else f"{words} (`rovid help {name}`)"
