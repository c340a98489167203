"""The page as PDF, printed by an installed browser."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from rovid.core.errors import ConfigError, OutputError
from rovid.core.output_files import plot_mark

# Programs on the PATH, and the usual places on macOS and Windows.
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_PLACES = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    r"C:\Program Files\Google\Chrome\Application\chrome.exe",
    r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
)
_TIMEOUT = 180.0  # s; enough for a large page on a busy machine
# Entry of a PDF that names the program which made it; its text may contain escaped brackets.
_MADE_BY = re.compile(rb"/(Creator|Producer) \(((?:\\.|[^\\()])*)\)")


def require_browser() -> str:
    """The path of an installed browser.

    Raises
    ------
    ConfigError
        There is none.
    """
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    found = found or next((place for place in _PLACES if Path(place).is_file()), None)
    if found is None:
        raise ConfigError(
            f"needs a browser; none of {', '.join(BROWSERS[:-1])} and {BROWSERS[-1]} was found.",
            where="--pdf",
            mend="Install one, or open the page in any browser and print it: the result is the same.",
        )
    return found


def print_pdf(page: Path, browser: str) -> bytes:
    """``page`` as PDF, with the mark by which rovid recognises its own files.

    Raises
    ------
    OutputError
        The browser made no PDF.
    """
    with tempfile.TemporaryDirectory(prefix="rovid", ignore_cleanup_errors=True) as name:
        made, profile = Path(name) / "page.pdf", Path(name) / "profile"
        command = [browser, "--headless=new", "--disable-gpu", "--no-pdf-header-footer", f"--user-data-dir={profile}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            # A browser does not run its sandbox as root; the page runs only its own script and fetches nothing.
            command.append("--no-sandbox")
        command += [f"--print-to-pdf={made}", page.resolve().as_uri()]
        try:
            done = subprocess.run(command, capture_output=True, check=False, timeout=_TIMEOUT)  # noqa: S603 - as found
        except (OSError, subprocess.TimeoutExpired) as error:
            raise _no_pdf(page, browser, str(error)) from error
        if not made.is_file():
            *_, last_line = ["no message", *done.stderr.decode(errors="replace").split("\n")]
            raise _no_pdf(page, browser, last_line)
        return _marked(made.read_bytes())


def _no_pdf(page: Path, browser: str, why: str) -> OutputError:
    return OutputError(f"{browser} printed no PDF of {page}: {why}. The page was written: print it from a browser.")


def _marked(document: bytes) -> bytes:
    """The document with rovid's mark in place of the program's name, at the same length: a PDF has byte offsets."""
    mark = plot_mark("report").encode()
    for found in _MADE_BY.finditer(document):
        if len(found[2]) >= len(mark):
            start, stop = found.span(2)
            return document[:start] + mark.ljust(stop - start) + document[stop:]
    return document
