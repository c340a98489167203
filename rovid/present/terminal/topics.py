"""Pages of `rovid help`: their list, their text, their print on a terminal, and the search for words."""

import math
import re
from collections import Counter
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from rich.console import Console, ConsoleOptions, RenderResult
from rich.markdown import Markdown, Paragraph, TableElement

import rovid
from rovid.core.errors import ConfigError, close_matches, quoted_list, suggestion
from rovid.export import ALIASES as FORMAT_WORDS
from rovid.export import FORMATS
from rovid.present.console import ResultTable, print_labelled, print_text, text_column, wrap_text

# Pages in the order of the list; the effects and the faults of logs follow.
TOPICS = (
    *("questions", "own_logs", "logs", "files", "faults", "axes", "planar", "fit", "diagnose", "discover"),
    *("own_effects", "compare", "plan", "watch", "control", "export", "report", "open", "fleet", "api", "skill"),
    *("confusion", "hard", "troubleshooting", "glossary", "method", "effects"),
)
_INDEX = "README"
# Folders of pages, each with an index.
_CATALOGUES = ("effects", "faults")
_PACKAGE = Path(rovid.__file__).parent
# Search word -> topic.
_ALSO = {
    **dict.fromkeys((*FORMATS, *FORMAT_WORDS), "export"),
    **dict.fromkeys(("surge", "sway", "heave", "roll", "pitch", "yaw", "axis"), "axes"),
    **dict.fromkeys(("rovid.toml", "json", "parameters", "toml", "configuration", "units"), "files"),
    **dict.fromkeys(("formats", "csv", "mcap", "parquet", "ulog", "bag", "dataflash", "nmea", "convert"), "logs"),
    **dict.fromkeys(("begin", "start", "tutorial", "init", "check"), "own_logs"),
    **dict.fromkeys(("app", "browser", "gui", "server"), "open"),
    **dict.fromkeys(("drag", "inertia", "fit-drag", "fit-inertia"), "fit"),
    **dict.fromkeys(("python", "notebook", "dataframe"), "api"),
    **dict.fromkeys(("mcp", "assistant", "agent", "schema"), "skill"),
    **dict.fromkeys(("cite", "citation", "faq", "question"), "questions"),
    **dict.fromkeys(("history", "refit", "before", "payload", "fouling"), "compare"),
}
# A comment, the front matter of instructions for assistants, and a directive of the site.
_COMMENT = re.compile(r"<!--.*?-->\n*|\A---\n.*?^---\n+|^```\{eval-rst\}\n.*?^```\n+", re.DOTALL | re.MULTILINE)
# A picture, and the paragraph on how it was drawn.
_PICTURE = re.compile(r"^\[?!\[[^\n]*\n+(?:Step: .*?\n\n)?", re.MULTILINE | re.DOTALL)
_TAG = re.compile(r"</?su[bp]>")
_LINK = re.compile(r"\[([^\]]+)\]\(([^)\s]+)\)")


def topic_names() -> list[str]:
    """Names of all topics: the pages, then the effects and the faults of logs by their ids."""
    return [*TOPICS, *catalogue_pages("effects"), *catalogue_pages("faults")]


def catalogue_pages(folder: str) -> list[str]:
    """Ids of the pages in one of the folders "effects" and "faults"."""
    return sorted(page.stem for page in (_folder() / folder).glob("*.md") if page.stem != _INDEX)


def topic_title(topic: str) -> str:
    """The heading of a page."""
    return next(line[2:] for line in topic_text(topic).splitlines() if line.startswith("# "))


def topic_text(topic: str) -> str:
    """A page as Markdown without pictures and links. Raises ConfigError, with the nearest topics, if there is none."""
    there = topic_names()
    if topic not in there:
        nearest = suggestion(topic, there, _synonyms())
        raise ConfigError(f"there is no page {topic!r}. {nearest}", mend="`rovid help` lists them all.")
    page = _TAG.sub("", _COMMENT.sub("", _path(topic).read_text(encoding="utf-8")))
    page = _LINK.sub(lambda link: _reference(link, topic), _PICTURE.sub("", page))
    if "sample_logs/" in page:
        page += "\nThe sample logs come with rovid's sources.\n"
    return page


def _synonyms() -> dict[str, str]:
    """Search word -> topic."""
    # The catalogue is slow to import, and needed only for a name that was not found.
    from rovid.effects import SYNONYMS

    return _ALSO | dict(SYNONYMS)


def _folder() -> Path:
    """The folder of the pages: next to the code of an installed rovid, docs/ in a checkout."""
    installed = _PACKAGE / "pages"
    return installed if installed.is_dir() else _PACKAGE.parent / "docs"


def _path(topic: str) -> Path:
    if topic in _CATALOGUES:
        return _folder() / topic / f"{_INDEX}.md"
    if topic == "skill":
        return _PACKAGE / "SKILL.md"
    if topic in TOPICS:
        return _folder() / f"{topic}.md"
    return next(path for name in _CATALOGUES if (path := _folder() / name / f"{topic}.md").exists())


def _reference(link: re.Match[str], topic: str) -> str:
    """A link as words, with its target where that is a page or an address."""
    words, target = link.groups()
    if target.startswith("http"):
        return f"{words} ({target})"
    page = Path(target.partition("#")[0])
    name = page.parent.name if page.stem == _INDEX else page.stem
    # The title of an effect is nearly its id.
    known = name in {topic, words, words.replace(" ", "_")}
    return words if page.suffix != ".md" or known or name not in topic_names() else f"{words} (`rovid help {name}`)"


# Largest line length in characters, for readability.
_WIDEST = 100


def show_markdown(console: Console, text: str) -> None:
    """Print a text in Markdown."""
    console.print(_Page(text, code_theme="bw", hyperlinks=False), width=min(console.width, _WIDEST))


def show_topics(console: Console) -> None:
    """Print the list of pages."""
    text = "`rovid help TOPIC` prints one of these pages, `rovid help COMMAND` the manual of a command, and "
    print_text(console, f"{text}`rovid help WORDS` the passages with most of these words.")
    console.print()
    effects, faults = catalogue_pages("effects"), catalogue_pages("faults")
    for caption, topics in (("Pages", TOPICS), ("Effects", effects), ("Faults of logs", faults)):
        titles = [text_column("topic", topics), text_column("title", map(topic_title, topics))]
        console.print(ResultTable(caption, *titles))


class _MarkdownTable(TableElement):
    """A table with wrapped cells, none of which is cut off."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table."""
        headings = self.header.row.cells if self.header and self.header.row else []
        table = ResultTable("", *(text_column(cell.content.plain) for cell in headings))
        for row in self.body.rows if self.body else ():
            table.add_row(*(cell.content for cell in row.cells))
        yield table


class _WrappedParagraph(Paragraph):
    """A paragraph in which numbers stay with their units."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the wrapped text."""
        yield wrap_text(self.text, options.max_width)


class _Page(Markdown):
    elements: ClassVar[dict[str, Any]] = {
        **Markdown.elements,
        "paragraph_open": _WrappedParagraph,
        "table_open": _MarkdownTable,
    }


# Words of a question that no passage needs to hold.
_COMMON = """a about an and are be can do does for from has have how i in is it long many me mean much my need no not of
    on or must should the there to too use what when where which who why will with would you"""
# Most passages shown, and the least share of the words, by their rarity, that a passage holds. Decisions.
_MOST, _LEAST_SHARE = 4, 0.5
# Least similarity of a page's name to a word that passages hold. A decision.
_SIMILAR = 0.8
# A paragraph, a row of a table, or an item of a list.
_END_OF_BLOCK = re.compile(r"\n\s*\n|\n(?=\||\* |\d+\. )")
_HEADING = re.compile(r"^(#.*\n)", re.MULTILINE)
_CODE = re.compile(r"^ *```.*?^ *```$", re.DOTALL | re.MULTILINE)


class Passage(NamedTuple):
    """A paragraph of a page, with the last heading above it."""

    topic: str
    heading: str
    text: str


def find_passages(words: str) -> list[Passage]:
    """The passages that hold most of the ``words``.

    Rare words count more, words of a heading half as much again. A passage on an option of this name comes first.
    """
    passages = list(_passages())
    heads = [_stems(f"{name} {one.heading}") for name, one in passages]
    texts = [head | _stems(one.text) for head, (_, one) in zip(heads, passages, strict=True)]
    counts = Counter(chain.from_iterable(texts))
    weights = {word: math.log(len(texts) / max(counts[word], 1)) for word in _stems(words) - _stems(_COMMON)}
    total, option = sum(weights.values()), re.compile(rf"--{re.escape('-'.join(words.lower().split()))}(?![\w-])")
    scores = []
    for head, text, (_, one) in zip(heads, texts, passages, strict=True):
        held, stressed = (sum(weights[word] for word in weights.keys() & part) for part in (text, head))
        named = total * bool(option.search(one.text))
        scores.append(held + 0.5 * stressed + named if held >= _LEAST_SHARE * total else 0.0)
    best = sorted(range(len(scores)), key=lambda place: -scores[place])[:_MOST]
    return [passages[place][1] for place in best if scores[place] > 0.0]


def show_page_or_passages(console: Console, topic: str) -> None:
    """Print a page, or the passages that hold most words; ConfigError without either."""
    try:
        show_markdown(console, topic_text(topic))
        return
    except ConfigError:
        passages = find_passages(topic)
        if not passages:
            raise
    for one in passages:
        print_labelled(console, f"rovid help {one.topic}:", one.heading)
        show_markdown(console, one.text)
        console.print()
    # Several words are a question; one word may be a page's name with an error.
    similar = [] if " " in topic else close_matches(topic, topic_names(), _synonyms(), _SIMILAR)
    pages = f"Pages with similar names: {quoted_list(similar)}. " if similar else ""
    print_text(console, f"{pages}`rovid help` lists them all." if similar else "`rovid help` lists the pages.")


def _passages() -> Iterator[tuple[str, Passage]]:
    """Name and title of a page, and each of its passages."""
    for topic in topic_names():
        heading, name = "", f"{topic.replace('_', ' ')} {topic_title(topic)}"
        for block in _END_OF_BLOCK.split(_HEADING.sub(r"\1\n", _CODE.sub("", topic_text(topic)))):
            if block.startswith("#"):
                heading = block.strip("# ")
            elif block.startswith("|") and re.search(r"\w", block):
                cells = [cell.strip() for cell in block.strip("| ").split("|")]
                yield name, Passage(topic, heading, ": ".join(filter(None, cells)))
            elif re.search(r"\w", block):
                yield name, Passage(topic, heading, block.removeprefix("* "))


def _stems(text: str) -> set[str]:
    """The words of ``text`` in lower case, without the ending of a plural or of a verb."""
    return {re.sub(r"(?<=...)(ing|ed|es|s|e)$", "", word) for word in re.findall(r"[^\W_]+", text.lower())}
