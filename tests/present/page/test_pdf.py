"""The page on paper, where the machine has a browser, and one clear message where it has none."""

from __future__ import annotations

import os
import re
import stat
import sys
from pathlib import Path

import pytest

from rovid.core.errors import ConfigError, OutputError
from rovid.core.output_files import OutputFile, OutputSet, pdf_signature
from rovid.present.page import page_files
from tests.conftest import SAMPLES, Rovid
from tests.present.chromium import find_chromium

posix = pytest.mark.skipif(os.name != "posix", reason="the program that stands for a browser is a script")
REPORT = ("report", SAMPLES / "rosub_tank" / "hold_01.csv", "--pdf", "--no-diagnosis", "--no-control", "--no-export")


def browser_that(folder: Path, does: str) -> str:
    """A program that is called as a browser is, and does in Python what it is told; ``made`` is where a PDF goes."""
    program = folder / "browser"
    told = "made = next(each for each in sys.argv if each.startswith('--print-to-pdf=')).partition('=')[2]"
    program.write_text(f"#!{sys.executable}\nimport pathlib, sys\n{told}\n{does}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return str(program)


@pytest.mark.skipif(find_chromium() is None, reason="no browser")
def test_the_page_is_printed_and_known_again(rovid: Rovid) -> None:
    done = rovid(*REPORT, "--json")
    assert done.code == 0, done.err
    path = Path(done.document["pdf"])
    assert path == Path("report/report.pdf")
    document = path.read_bytes()
    assert document.startswith(b"%PDF-")
    assert pdf_signature("report").matches(path)
    # Nothing moved in it: the table of its parts stands where the end says.
    at = re.search(rb"startxref\s+(\d+)\s+%%EOF", document)
    assert at is not None
    assert document[int(at[1]) :].startswith(b"xref")
    OutputSet([OutputFile(path, pdf_signature("report"))])  # which may be written again


def test_without_a_browser_nothing_is_begun(rovid: Rovid, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_files, "BROWSERS", ("no-such-browser", "nor-this"))
    monkeypatch.setattr(page_files, "_PLACES", ())
    with pytest.raises(ConfigError, match=r"none of no-such-browser and nor-this was found.* print it"):
        page_files.require_browser()
    monkeypatch.setenv("PATH", "")
    done = rovid(*REPORT)
    assert done.code == 2
    assert "--pdf" in done.err
    assert not Path("report").exists()


def test_a_pdf_of_somebody_else_is_not_replaced(rovid: Rovid) -> None:
    Path("report").mkdir()
    Path("report/report.pdf").write_bytes(b"%PDF-1.4\n1 0 obj\n<</Creator (Writer)>>\n")
    done = rovid(*REPORT)
    assert done.code == 2
    assert "report.pdf" in done.err or "browser" in done.err


@posix
@pytest.mark.parametrize("does", ["sys.exit('it is broken')", ""])
def test_a_browser_that_prints_nothing_is_one_message(tmp_path: Path, does: str) -> None:
    page = tmp_path / "index.html"
    page.write_text("<p>x")
    with pytest.raises(OutputError, match=r"printed no PDF of .* print it from a browser"):
        page_files.print_pdf(page, browser_that(tmp_path, does))
    with pytest.raises(OutputError, match="printed no PDF"):
        page_files.print_pdf(page, str(tmp_path / "not there"))


@posix
def test_the_mark_moves_no_byte(tmp_path: Path) -> None:
    page = tmp_path / "index.html"
    page.write_text("<p>x")
    made = rb"%PDF-1.4 <</Title (a)/Creator (Mozilla \(X11\) Chrome)/Producer (Skia/PDF m156)>> end"
    document = page_files.print_pdf(page, browser_that(tmp_path, f"pathlib.Path(made).write_bytes({made!r})"))
    assert document == made.replace(rb"Mozilla \(X11\) Chrome", b"rovid report".ljust(22))
