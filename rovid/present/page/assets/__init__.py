"""What a page carries inside itself besides its own style: the plotting library and the viewer's script."""

from __future__ import annotations

import base64
import hashlib
from dataclasses import dataclass
from importlib.resources import files

from markupsafe import Markup


@dataclass(frozen=True, kw_only=True)
class Assets:
    """Script and style, to be put into the page as they are."""

    script: Markup
    style: Markup

    @property
    def script_source(self) -> Markup:
        """The script's hash, by which a Content-Security-Policy lets it run and no other."""
        digest = hashlib.sha256(self.script.encode()).digest()
        return Markup("'sha256-{}'").format(base64.b64encode(digest).decode("ascii"))


def read_assets() -> Assets:
    """The library, under its licence, and the script that uses it."""
    folder = files("rovid.present.page.assets")
    licence, library, style = (
        (folder / "uplot" / name).read_text(encoding="utf-8")
        for name in ("LICENSE", "uPlot.iife.min.js", "uPlot.min.css")
    )
    viewer = (folder / "viewer.js").read_text(encoding="utf-8")
    return Assets(script=_trusted(f"/*\n{licence}*/\n{library}{viewer}"), style=_trusted(style))


def _trusted(text: str) -> Markup:
    """Text of this package, in which nothing of a log can be."""
    return Markup(text)  # noqa: S704
