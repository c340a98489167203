"""Progress in notebooks: one line below the running cell, until the result is there."""

from __future__ import annotations

import contextlib
import importlib
import sys
from collections.abc import Iterator

from rovid.core.budget import ProgressCallback


@contextlib.contextmanager
def notebook_progress(first: str) -> Iterator[ProgressCallback]:
    """A function that shows a line in place of the last one, from ``first`` on; silent outside a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if not hasattr(shell, "kernel"):  # as in a script or in IPython's terminal
        yield lambda _: None
        return
    display = importlib.import_module("IPython.display").display
    shown = display({"text/plain": first}, raw=True, display_id=True)
    try:
        yield lambda line: shown.update({"text/plain": line}, raw=True)
    finally:
        shown.update({"text/plain": ""}, raw=True)
