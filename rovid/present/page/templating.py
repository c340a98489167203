"""Templates of pages: all that a log may hold is escaped, numbers are rounded, and one style is shared."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rovid.core.errors import escape_invisible
from rovid.core.formatting import plus_minus
from rovid.present.number_text import as_sentence, equal_decimals, format_number, unit_symbol
from rovid.present.terminal.wrapping import bind_units

if TYPE_CHECKING:
    from jinja2 import Environment


def template_environment(*packages: str) -> Environment:
    """Where templates are looked for: in the ``packages``, then among the report's own."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    def shown(value: object) -> object:
        if isinstance(value, str) and not isinstance(value, Markup):
            return escape_invisible(value)
        return value

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package) for package in (*packages, "rovid.present.page")]),
        autoescape=True,
        undefined=StrictUndefined,
        # What was escaped already is ours, line ends included.
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["bound"] = bind_units
    environment.filters["number"] = format_number
    environment.filters["prose"] = as_sentence
    environment.filters["unit"] = unit_symbol
    environment.filters["plain"] = lambda value, significant=4: equal_decimals([value], significant)[0]
    environment.filters["short"] = lambda value: equal_decimals([value], 2)[0]
    environment.globals["plus_minus"] = plus_minus
    return environment
