"""The user's browser, sent to the page without its address in the list of this machine's processes."""

from __future__ import annotations

import atexit
import shutil
import tempfile
import threading
import webbrowser
from pathlib import Path


def show_in_browser(address: str) -> None:
    """Open a browser at ``address``, by way of a file that nobody else may read."""
    # Of this mode by itself: 0700. What a program is called with, all users of a machine may read.
    folder = Path(tempfile.mkdtemp(prefix="rovid-open-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    page = folder / "rovid.html"
    refresh = f'<meta http-equiv="refresh" content="0;url={address}">'
    page.write_text(f"<!doctype html>\n<title>rovid</title>\n{refresh}\n", encoding="utf-8")
    # A browser in the terminal would not return.
    threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()
