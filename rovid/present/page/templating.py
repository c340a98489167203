"""Templates of pages: all text is escaped, numbers are rounded, and all pages share one style."""

from __future__ import annotations

import base64
import hashlib
import itertools
from dataclasses import dataclass
from datetime import date
from importlib.resources import files
from typing import TYPE_CHECKING

from markupsafe import Markup

from rovid.core.errors import escape_invisible
from rovid.core.formatting import plus_minus
from rovid.present.console import bind_units
from rovid.present.number_format import as_sentence, equal_decimals, format_number, unit_symbol

if TYPE_CHECKING:
    from jinja2 import Environment


def template_environment(*packages: str) -> Environment:
    """An environment that looks for templates in ``packages``, then among those of the report."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    def escaped(value: object) -> object:
        # Markup is already escaped, and keeps its line ends.
        if isinstance(value, str) and not isinstance(value, Markup):
            return escape_invisible(value)
        return value

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package) for package in (*packages, "rovid.present.page")]),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=escaped,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["bound"] = bind_units
    environment.filters["code"] = _with_code
    environment.filters["number"] = lambda value, form=".4g": format_number(value, form)
    environment.filters["prose"] = as_sentence
    environment.filters["unit"] = unit_symbol
    environment.filters["plain"] = lambda value, digits=4: equal_decimals([value], digits)[0]
    environment.filters["short"] = lambda value: equal_decimals([value], 2)[0]
    environment.globals["plus_minus"] = plus_minus
    return environment


def _with_code(text: str) -> Markup:
    """``text`` with bound units, and its parts between backticks as code."""
    marks = itertools.cycle((Markup("{}"), Markup("<code>{}</code>")))
    return Markup("").join(mark.format(part) for mark, part in zip(marks, bind_units(text).split("`"), strict=False))


def long_date(day: date) -> str:
    """A date in words: "7 March 2026"."""
    return f"{day:%d %B %Y}".lstrip("0")


@dataclass(frozen=True, kw_only=True)
class Assets:
    """Script and style that a page contains as they are."""

    script: Markup
    style: Markup

    @property
    def script_source(self) -> Markup:
        """The script's hash; with it a Content-Security-Policy permits this script and no other."""
        digest = hashlib.sha256(self.script.encode()).digest()
        return Markup("'sha256-{}'").format(base64.b64encode(digest).decode("ascii"))


def read_assets() -> Assets:
    """The plotting library with its licence, and the viewer's script."""
    folder = files("rovid.present.page") / "assets"
    licence, library, style = (
        (folder / "uplot" / name).read_text(encoding="utf-8")
        for name in ("LICENSE", "uPlot.iife.min.js", "uPlot.min.css")
    )
    viewer = (folder / "viewer.js").read_text(encoding="utf-8")
    # Files of this package, without any text from logs.
    script = Markup(f"/*\n{licence}*/\n{library}{viewer}")  # noqa: S704
    return Assets(script=script, style=Markup(style))  # noqa: S704
