"""The page as PDF, printed by a browser that the machine has."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from rovid.core.errors import ConfigError, OutputError
from rovid.core.signatures import plot_mark

# On the PATH, and where macOS and Windows keep theirs.
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_PLACES = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    r"C:\Program Files\Google\Chrome\Application\chrome.exe",
    r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
)
_PATIENCE = 180.0  # s; a large page on a busy machine
# Where a PDF says by what it was made: a text in brackets, of which some may stand in it behind a stroke.
_MADE_BY = re.compile(rb"/(Creator|Producer) \(((?:\\.|[^\\()])*)\)")


def require_browser() -> str:
    """The program that prints.

    Raises
    ------
    ConfigError
        There is none.
    """
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    found = found or next((place for place in _PLACES if Path(place).is_file()), None)
    if found is None:
        raise ConfigError(
            f"takes a browser; {', '.join(BROWSERS[:-1])} or {BROWSERS[-1]} was looked for, and none is there.",
            where="--pdf",
            mend="Install one, or open the page in any browser and print it: it prints alike.",
        )
    return found


def print_pdf(page: Path, browser: str) -> bytes:
    """``page`` as PDF, with the mark by which rovid knows its own.

    Raises
    ------
    OutputError
        The browser made none.
    """
    with tempfile.TemporaryDirectory(prefix="rovid", ignore_cleanup_errors=True) as name:
        made, folder = Path(name) / "page.pdf", Path(name) / "profile"
        command = [browser, "--headless=new", "--disable-gpu", "--no-pdf-header-footer", f"--user-data-dir={folder}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            # A browser refuses to be root's in its sandbox; the page runs no script but its own and asks for nothing.
            command.append("--no-sandbox")
        command += [f"--print-to-pdf={made}", page.resolve().as_uri()]
        try:
            done = subprocess.run(command, capture_output=True, check=False, timeout=_PATIENCE)  # noqa: S603 - as found
        except (OSError, subprocess.TimeoutExpired) as error:
            raise _failed(page, browser, str(error)) from error
        if not made.is_file():
            *_, said = ["nothing was said", *done.stderr.decode(errors="replace").split("\n")]
            raise _failed(page, browser, said)
        return _marked(made.read_bytes())


def _failed(page: Path, browser: str, why: str) -> OutputError:
    return OutputError(f"{browser} printed no PDF of {page}: {why}. The page is there: print it from a browser.")


def _marked(document: bytes) -> bytes:
    """With rovid in the place of what made it, to the byte as long: a PDF knows where each of its parts begins."""
    mark = plot_mark("report").encode()
    for found in _MADE_BY.finditer(document):
        if len(found[2]) >= len(mark):
            start, stop = found.span(2)
            return document[:start] + mark.ljust(stop - start) + document[stop:]
    return document
