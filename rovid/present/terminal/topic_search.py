"""Search of the documentation for `rovid help WORDS`."""

import re
from collections.abc import Iterator
from typing import NamedTuple

from rich.console import Console

from rovid.core.errors import ConfigError
from rovid.present.console import print_labelled, print_text
from rovid.present.number_format import as_sentence
from rovid.present.terminal.topics import show_markdown, show_topic, topic_names, topic_text

# Words of a question that no passage needs to hold.
_COMMON = """a about an and are be can do does for from has have how i in is it long many me mean much my need of on or
    should the to use what when where which who why will with you"""
# Most passages shown.
_MOST = 4
# A paragraph, a row of a table, or an item of a list.
_END_OF_BLOCK = re.compile(r"\n\s*\n|\n(?=\||\* |\d+\. )")
_CODE = re.compile(r"^ *```.*?^ *```$", re.DOTALL | re.MULTILINE)


class Passage(NamedTuple):
    """A paragraph of a page, with the last heading above it."""

    topic: str
    heading: str
    text: str


def find_passages(words: str) -> list[Passage]:
    """The passages with all ``words``, those with the words in their heading first."""
    wanted = _stems(words) - _stems(_COMMON)
    found = [one for one in _passages() if wanted and wanted <= _stems(f"{one.heading} {one.text}")]
    return sorted(found, key=lambda one: [-len(wanted & _stems(part)) for part in one[1:]])[:_MOST]


def show_page_or_passages(console: Console, topic: str) -> None:
    """Print a page, or the passages that hold all words; ConfigError without either."""
    try:
        show_topic(console, topic)
        return
    except ConfigError as error:
        passages, nearest = find_passages(topic), as_sentence(str(error))
        if not passages:
            raise
    for one in passages:
        print_labelled(console, f"rovid help {one.topic}:", one.heading)
        show_markdown(console, one.text)
        console.print()
    # Several words are a question; one word may be a page's name with an error.
    print_text(console, "`rovid help` lists the pages." if " " in topic else nearest)


def _passages() -> Iterator[Passage]:
    for topic in topic_names():
        heading = ""
        for block in _END_OF_BLOCK.split(_CODE.sub("", topic_text(topic))):
            if block.startswith("#"):
                heading = block.strip("# ")
            elif block.startswith("|"):
                cells = [cell.strip() for cell in block.strip("| ").split("|")]
                yield Passage(topic, heading, ": ".join(filter(None, cells)))
            else:
                yield Passage(topic, heading, block.removeprefix("* "))


def _stems(text: str) -> set[str]:
    """The words of ``text`` in lower case, without the s of a plural."""
    return {word.removesuffix("s") if len(word) > 3 else word for word in re.findall(r"[^\W_]+", text.lower())}
