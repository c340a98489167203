"""Documentation: the site builds without warnings and needs no network, and its commands work as described.

Every sh and console block of docs/ and of the README is run, page by page and in order, in a separate folder. In a
console block commands begin with ``$``. The following lines have to occur in the output, in this order, with nearly
equal numbers; ``…`` marks omitted text. Python blocks are run too, and pycon blocks are doctests; both share their
names within a page. A comment before a block marks exceptions:

``<!-- test: not run; WHY -->``
    The block needs a network or hours.
``<!-- test: as in PAGE -->``
    PAGE contains the same commands in this order, and they are run there.
``<!-- test: slow; WHY -->``
    The block is run only by ``make test-slow``.
``<!-- test: written to FILE -->``
    The block is the content of a file, and the test writes it.
``<!-- test: added to FILE -->``, ``<!-- test: added to NAME in FILE -->``
    The block is appended to a file, or to a list in it; see test_developing.py.
"""

from __future__ import annotations

import contextlib
import doctest
import importlib.resources
import importlib.util
import inspect
import io
import itertools
import os
import pkgutil
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote, urlsplit

import numpy as np
import pytest
from docutils.core import publish_doctree
from docutils.nodes import system_message
from PIL import Image
from playwright.sync_api import sync_playwright
from typer.main import get_command

from docs.make_pictures import FOLDER, PAGE, PICTURES, SCREENS, has_browser, screens
from rovid.cli.cli import app
from rovid.diagnose.result import Diagnosis
from tests.conftest import ROOT, SAMPLES, blank_plots, diagnosed_once, run_rovid, slow, write_short_day

DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
SHELL = {"sh", "console", "bash", "shell"}
FENCE = re.compile(
    r"(?:^<!-- test: (?P<remark>[^>]*?) -->\n+)?^```(?P<language>[\w-]+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
NUMBER = r"(?<![\d.])\d+(?:\.\d+)?(?!\.?\d)"
# Mean difference of two reduced pictures on a scale of 255: 3.7 to 5 for another run or another vehicle, 1.1 to 1.8 if
# all lines are shifted by one pixel, as with other fonts.
LARGEST_DIFFERENCE = 3.0
# Pages that need a parameter file. They start with the parameters of a shortened sample day, to save time.
WITH_PARAMETERS = {"control.md", "export.md", "files.md", "fit.md", "logs.md", "plan.md"}


@dataclass(frozen=True)
class Block:
    """A fenced block of a page, and the remark in the comment before it."""

    page: Path
    line: int
    language: str
    text: str
    remark: str

    @property
    def place(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def steps(self) -> list[tuple[str, list[str]]]:
        """Pairs (command, lines of its output)."""
        if self.language != "console":
            return [(line, []) for line in self.text.replace("\\\n", " ").splitlines() if line.strip()]
        steps: list[tuple[str, list[str]]] = []
        for line in self.text.splitlines():
            if line.startswith("$ "):
                steps.append((line[2:], []))
            else:
                assert steps, f"{self.place}: output without a command"
                steps[-1][1].append(line)
        return steps

    def commands(self) -> list[list[str]]:
        if self.language not in SHELL:
            return []
        return [words for command, _ in self.steps() if (words := shlex.split(command, comments=True))]


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [
        Block(page, text[: found.start()].count("\n") + 1, found["language"], found["text"], found["remark"] or "")
        for found in FENCE.finditer(text)
    ]


def to_run(page: Path) -> list[Block]:
    """Blocks of a page to run or to write, in order."""
    return [
        block
        for block in blocks(page)
        if (block.language in SHELL and not block.remark.startswith(("not run;", "as in ")))
        or block.language in {"python", "pycon"}
        or block.remark.startswith("written to ")
    ]


def of_this_run(page: Path, *, slow: bool) -> list[Block]:
    """Blocks that are not slow; with ``slow``, all blocks of a page with a slow block."""
    everything = to_run(page)
    quick = [block for block in everything if not block.remark.startswith("slow;")]
    if slow:
        return everything if len(quick) < len(everything) else []
    return quick


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.fixture(scope="session")
def trial_day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a short trial day and its parameters."""
    folder = tmp_path_factory.mktemp("ready")
    write_short_day(folder / "trial_day")
    with contextlib.chdir(folder):
        for command in ("fit-drag", "fit-inertia"):
            assert run_rovid(command, "trial_day").code == 0
    return folder


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Working folder of a reader: the sample logs of the checkout, and logs of her own."""
    shutil.copytree(SAMPLES, tmp_path / "sample_logs", ignore=shutil.ignore_patterns("parameters*.toml"))
    write_short_day(tmp_path / "my_logs", configured=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    return tmp_path


@pytest.fixture(scope="module")
def known() -> dict[str, Diagnosis]:
    """Cache of diagnoses."""
    return {}


def run(page: Path, chosen: list[Block], request: pytest.FixtureRequest) -> None:
    if page.name in WITH_PARAMETERS:
        shutil.copytree(request.getfixturevalue("trial_day"), Path.cwd(), dirs_exist_ok=True)
    names: dict[str, object] = {}
    for block in chosen:
        if block.remark.startswith("written to "):
            path = Path(block.remark.removeprefix("written to "))
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        elif block.language == "pycon":
            run_doctest(block, names)
        elif block.language == "python":
            with contextlib.redirect_stdout(io.StringIO()):
                exec(compile(block.text, block.place, "exec"), names)  # noqa: S102 - the page's own example
        else:
            for command, shown in block.steps():
                require_lines(shown, output_of(command, block), f"{block.place}: {command}")
    if any(words[:2] == ["rovid", "report"] for block in chosen for words in block.commands()):
        assert min(made.stat().st_size for made in Path.cwd().glob("*/index.html")) > 100_000
        assert list(Path.cwd().glob("parameters*.toml"))


def run_doctest(block: Block, names: dict[str, object]) -> None:
    case = doctest.DocTestParser().get_doctest(block.text, {}, block.place, block.place, 0)
    case.globs = names
    failures: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL)
    assert case.examples
    assert runner.run(case, out=failures.append, clear_globs=False).failed == 0, "".join(failures)


def output_of(command: str, block: Block) -> str:
    words = shlex.split(command, comments=True)
    if words[:1] == ["rovid"] and not {"|", ">", ">>", "&&", ";"} & set(words):
        # Run in this process: starting Python for every line would take most of the time.
        done = run_rovid(*words[1:])
        assert done.code == 0, f"{block.place}: {command}\n{done.err}"
        assert done.err == "", f"{block.place}: {command}"
        return done.out
    shell = subprocess.run(["bash", "-euc", command], check=False, capture_output=True, text=True)
    assert shell.returncode == 0, f"{block.place}: {command}\n{shell.stderr}"
    return shell.stdout


def require_lines(shown: list[str], printed: str, place: str) -> None:
    """Assert that every shown line is printed, in order; parts of a line around … are matched in order."""
    lines = iter(" ".join(line.split()) for line in printed.splitlines())
    for line in shown:
        if line.replace("…", "").strip():
            found = any(matches(line, candidate) for candidate in lines)
            assert found, f"{place}\nnot printed: {line}\n{printed}"


def matches(shown: str, printed: str) -> bool:
    """Whether a shown line matches a printed line, with nearly equal numbers."""
    parts = [" ".join(part.split()) for part in shown.split("…")]
    words = ".*?".join(f"({NUMBER})".join(map(re.escape, re.split(NUMBER, part))) for part in parts)
    found = re.search(words, printed) if len(parts) > 1 else re.fullmatch(words, printed)
    return found is not None and all(map(nearly, re.findall(NUMBER, " ".join(parts)), found.groups()))


def nearly(shown: str, printed: str) -> bool:
    """Whether two numbers agree up to rounding of processors; integers below 100 are counts and must be equal."""
    value, decimals = float(shown), len(shown.partition(".")[2])
    digit = 2.0 * 10.0**-decimals if decimals else 0.0
    return abs(float(printed) - value) <= max(digit, 0.01 * value if decimals or value >= 100.0 else 0.0)


def with_something(*, slow: bool) -> list[Path]:
    return [page for page in PAGES if of_this_run(page, slow=slow)]


# Pages whose commands other tests of `make test` run too.
LONG = {"api", "control", "plan"}


@pytest.mark.parametrize(
    "page", [slow(page) if page.stem in LONG else page for page in with_something(slow=False)], ids=name_of
)
@pytest.mark.usefixtures("folder")
def test_commands_of_a_page(page: Path, known: dict[str, Diagnosis], request: pytest.FixtureRequest) -> None:
    with blank_plots(), diagnosed_once(known):
        run(page, of_this_run(page, slow=False), request)


@pytest.mark.slow
@pytest.mark.parametrize("page", with_something(slow=True), ids=name_of)
@pytest.mark.usefixtures("folder")
def test_slow_commands_of_a_page(page: Path, request: pytest.FixtureRequest) -> None:
    run(page, of_this_run(page, slow=True), request)
    if page.name == "tutorial.md":
        apart = {name: difference(Path(made), FOLDER / name) for name, made in PICTURES.items()}
        if has_browser():
            screens(Path(PAGE), Path.cwd())
            apart |= {name: difference(Path(name), FOLDER / name) for name in SCREENS}
        assert max(apart.values()) < LARGEST_DIFFERENCE, f"{apart}: run python -m docs.make_pictures"


def difference(made: Path, kept: Path) -> float:
    first, second = (
        np.asarray(Image.open(path).convert("L").resize((120, 80), Image.Resampling.BOX), dtype=float)
        for path in (made, kept)
    )
    return float(np.abs(first - second).mean())


def test_blocks_that_are_not_run_have_a_reason() -> None:
    for block in (block for page in PAGES for block in blocks(page)):
        assert re.fullmatch(
            r"|(not run|slow); .{10,}|as in \S+\.md|written to \S+|added to (\w+ in )?\S+", block.remark
        ), block.place
        if block.remark.startswith("as in "):
            there = DOCS / block.remark.removeprefix("as in ")
            rest = iter(words for other in to_run(there) for words in other.commands())
            missing = [words for words in block.commands() if words not in rest]
            assert not missing, f"{block.place}: {missing} not in {there.name}"


def test_every_command_is_in_some_page() -> None:
    shown = {words[1] for page in PAGES for block in to_run(page) for words in block.commands() if words[0] == "rovid"}
    group: Any = get_command(app)
    assert shown - {"--version"} == set(group.commands)


def test_commands_in_running_text_exist_with_their_options() -> None:
    group: Any = get_command(app)
    for page in PAGES:
        for text in re.findall(r"`(rovid [a-z][^`]*)`", " ".join(page.read_text(encoding="utf-8").split())):
            _, name, *words = text.split()
            assert name in group.commands, f"{page.name}: {text}"
            known = {option for parameter in group.commands[name].params for option in parameter.opts}
            known |= {option for parameter in group.commands[name].params for option in parameter.secondary_opts}
            unknown = {word for word in words if word.startswith("-")} - known - {"--help"}
            assert not unknown, f"{page.name}: {text}"


@pytest.mark.parametrize(
    "command",
    [
        "check trial_day",
        "fit-drag trial_day",
        "fit-inertia",
        "fit",
        "simulate",
        "control",
        "export json",
        "convert trial_day/hold_03.csv -o hold.csv",
        "fit-thruster trial_day/thrust_curve.csv",
        "init my_logs",
    ],
)
@pytest.mark.usefixtures("folder")
def test_the_keys_of_json_are_in_the_page_on_files(command: str, trial_day: Path) -> None:
    shutil.copytree(trial_day, Path.cwd(), dirs_exist_ok=True)
    document = run_rovid(*command.split(), "--json").document
    text = (DOCS / "files.md").read_text(encoding="utf-8")
    section = text.partition(f"### `{document['schema']}`")[2].partition("\n### ")[0]
    documented = set(
        re.findall(r"`(\w+)`", " ".join(line.split("|")[1] for line in section.splitlines() if "|" in line))
    )
    assert set(document) - {"schema"} <= documented


def test_the_page_on_files_has_every_schema_and_every_key_of_the_configuration() -> None:
    from rovid.readers import READERS
    from rovid.trial import axis, config, config_values

    text = (DOCS / "files.md").read_text(encoding="utf-8")
    sources = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "rovid").rglob("*.py"))
    schemas = set(re.findall(r"\brovid-[a-z-]+/1\b", sources))
    assert len(schemas) > 8
    keys = {*config._VEHICLE_KEYS, *config_values._THRUSTER_KEYS}  # noqa: SLF001 - the keys are private
    keys |= {"unit", "sign", *axis.SIGNAL_UNITS}
    units = {unit for factors in axis.SIGNAL_UNITS.values() for unit in factors} | {*axis.TIME_UNITS}
    formats = {suffix.removeprefix(".") for suffix in READERS} - {"db3"}
    assert sorted(name for name in keys | units | formats | schemas if f"`{name}`" not in text) == []


def test_make_demo_is_in_the_readme() -> None:
    assert "make demo" in (ROOT / "README.md").read_text()


def anchors(text: str) -> set[str]:
    """Anchors of a page: its headings, as named by GitHub and MyST."""
    outside = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#{1,3} (.*)$", outside, flags=re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_of_a_page_are_valid(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        parts = urlsplit(link)
        target = page.parent / parts.path if parts.path else page
        if not parts.scheme:
            assert target.is_file(), link
            assert not parts.fragment or parts.fragment in anchors(target.read_text(encoding="utf-8")), link


class Links(HTMLParser):
    """Links and anchors of an HTML page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value for key, value in attrs if value is not None}
        self.anchors |= {given[key] for key in ("id", "name") if key in given}
        if tag == "a":
            self.links += [given["href"]] if "href" in given else []
        else:
            self.loaded += [given[key] for key in ("src", "href", "data", "srcset") if key in given]


def test_each_name_of_the_python_interface_has_an_example() -> None:
    stable, _ = (DOCS / "api.md").read_text(encoding="utf-8").split("## Building blocks")
    examples = "".join(re.findall(r"^```(?:python|pycon)\n(.*?)^```", stable, re.MULTILINE | re.DOTALL))
    first = re.findall(r"^```python\n(.*?)^```", stable, re.MULTILINE | re.DOTALL)[0]
    assert len([line for line in first.splitlines() if line.strip()]) <= 12  # the promise, from a DataFrame to a cause
    listed = re.findall(r"auto(?:function|class):: ([\w.]+)\n(?:   :members: ([\w, ]+))?", stable)
    names = {name for owner, members in listed for name in (members or owner.rpartition(".")[2]).split(", ")}
    assert {"from_frame", "to_json", "interval_95", "open"} <= names
    assert sorted(name for name in names - {"Fault"} if not re.search(rf"\b{name}\b", examples)) == []


def test_docstrings_of_the_python_interface_are_well_formed() -> None:
    """Short for the whole site, which the next test builds."""
    for name in re.findall(r"auto(?:function|class):: (\S+)", (DOCS / "api.md").read_text(encoding="utf-8")):
        documented = pkgutil.resolve_name(name)
        members = vars(documented) if inspect.isclass(documented) else {}
        for each in (documented, *(member for key, member in members.items() if not key.startswith("_"))):
            tree = publish_doctree(inspect.getdoc(each) or "", settings_overrides={"report_level": 5})
            assert [found.astext() for found in tree.findall(system_message) if found["level"] > 2] == [], name


@pytest.mark.slow
def test_the_site_builds_without_a_warning_or_network_and_has_valid_links(tmp_path: Path) -> None:
    # One test, to build the site only once with several processes.
    site = build(tmp_path)
    sources = [path.relative_to(DOCS).with_suffix(".html") for path in DOCS.rglob("*.md")]
    assert len(sources) > 30
    assert [str(name) for name in sources if not (site / name).is_file()] == []
    pages = {path: Links(path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}
    assert {(path.name, link) for path, page in pages.items() for link in page.loaded if urlsplit(link).netloc} == set()
    for path in site.rglob("*.css"):
        assert re.findall(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", path.read_text(encoding="utf-8")) == [], path
    assert [(path.name, link) for path, page in pages.items() for link in broken(path, page, pages)] == []
    method = (site / "method.html").read_text(encoding="utf-8")
    assert method.count('<svg class="formula" role="img"') > 60
    assert "$" not in re.sub(r"<[^>]*>", "", method)
    assert re.findall(r'<svg class="formula"[^>]*aria-label="[^"]*\. [A-Z][^"]*"', method) == []  # no text is a formula
    if has_browser():
        assert_search_answers(site, tmp_path / "profile")
        assert_pages_are_accessible(site)


def test_excerpts_of_the_search_have_no_tags() -> None:
    from docutils import nodes

    spec = importlib.util.spec_from_file_location("docs_search", ROOT / "docs/extensions/search.py")
    assert spec is not None
    assert spec.loader is not None
    search = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(search)
    tags = (nodes.raw("", one, format="html") for one in ("<sub>", "</sub>"))
    pieces = [nodes.Text("x·F"), next(tags), nodes.Text("y"), next(tags)]
    assert search._text(nodes.paragraph("", "", *pieces)) == "x·Fy"  # noqa: SLF001 - entries() needs a whole page


# Questions that users have, and the section that answers each.
ASKED = {
    "yaw arm sign": "questions#which-sign-does-a-yaw-arm-have",
    "length of a hold": "questions#how-long-should-a-hold-be",
    "what is the noise floor": "questions#what-is-the-noise-floor",
    "meaning of the evidence words": "questions#what-do-confirmed-likely-possible-and-cannot-tell-mean",
    "likely": "questions#what-do-confirmed-likely-possible-and-cannot-tell-mean",
    "is my log format read": "questions#does-rovid-read-my-log-format",
    "supported formats": "questions#does-rovid-read-my-log-format",
    "thruster lag": "effects/thruster_lag#thruster-lag",
    "overwrite": "files#overwriting",
}


def assert_search_answers(site: Path, profile: Path) -> None:
    """The first hit answers each question, with an excerpt, from local files and without a request."""
    from tests.present.chromium import chromium

    # A comment above an example of planar.md.
    assert "fits of all three axes" not in (site / "_static" / "sections.js").read_text()
    with chromium(profile) as tab:
        for asked, answer in ASKED.items():
            tab.call("Page.navigate", url=f"{(site / 'search.html').as_uri()}?q={quote(asked)}")
            tab.until("Boolean(document.querySelector('#found a'))")
            first = tab.ask("document.querySelector('#found a').getAttribute('href')")
            assert first.replace(".html#", "#") == answer, asked
            assert len(tab.ask("document.querySelector('#found p').textContent")) > 60
            assert tab.ask("document.querySelectorAll('#found mark').length") > 0
        tab.call("Page.navigate", url=f"{(site / 'search.html').as_uri()}?q=%3Cimg+src%3Dx%3E+zyzzyva")
        tab.until("document.getElementById('count')?.textContent.includes('zyzzyva')")
        assert tab.ask("document.querySelectorAll('article img').length") == 0
        assert tab.complaints == []
        assert {urlsplit(url).scheme for url in tab.requests} <= {"file", "data"}


def assert_pages_are_accessible(site: Path) -> None:
    """axe-core finds nothing, on a wide and on a narrow screen."""
    from tests.present.chromium import find_chromium

    axe = (importlib.resources.files("axe_playwright_python") / "axe.min.js").read_text()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=["--no-sandbox"])
        for name, width in itertools.product(("index", "open", "method", "tutorial", "search"), (1280, 390)):
            page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme="dark")
            page.goto((site / f"{name}.html").as_uri())
            page.evaluate(axe)
            found = page.evaluate("axe.run().then(result => result.violations)")
            assert [(one["id"], node["html"]) for one in found for node in one["nodes"]] == [], (name, width)
            page.close()
        browser.close()


def build(folder: Path) -> Path:
    """Build the site like `make docs`."""
    options = ["-W", "--keep-going", "-q", "-b", "html", "-d", str(folder / "cache")]
    command = [sys.executable, "-m", "sphinx", *options, str(DOCS), str(folder / "html")]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return folder / "html"


def broken(path: Path, page: Links, pages: dict[Path, Links]) -> Iterator[str]:
    for link in (*page.links, *page.loaded):
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        anchor = unquote(parts.fragment)
        if not target.is_file() or (anchor and target in pages and anchor not in pages[target].anchors):
            yield link


def test_the_score_card_agrees_with_the_pages_on_hard_water_and_real_logs() -> None:
    from benchmarks.sweep import in_hard_water, of_real_logs

    head, _, _ = (DOCS / "confusion.md").read_text(encoding="utf-8").partition("\n## ")
    assert len(head.splitlines()) < 25  # one screen
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in head.splitlines() if line.startswith("| ")]
    for row in (*in_hard_water(), *of_real_logs()):
        assert row in rows, "update the table: python -m benchmarks.sweep --page-only, or by hand"
