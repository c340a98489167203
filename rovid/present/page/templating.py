"""Templates of pages: all that a log may hold is escaped, numbers are rounded, and one style is shared."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rovid.core.errors import visible
from rovid.core.formatting import plus_minus
from rovid.present.number_text import column, number, prose, unit
from rovid.present.terminal.wrapping import bound

if TYPE_CHECKING:
    from jinja2 import Environment


def environment_of(*packages: str) -> Environment:
    """Where templates are looked for: in the ``packages``, then among the report's own."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    def shown(value: object) -> object:
        if isinstance(value, str) and not isinstance(value, Markup):
            return visible(value)
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
    environment.filters["bound"] = bound
    environment.filters["number"] = number
    environment.filters["prose"] = prose
    environment.filters["unit"] = unit
    environment.filters["plain"] = lambda value, significant=4: column([value], significant)[0]
    environment.filters["short"] = lambda value: column([value], 2)[0]
    environment.globals["plus_minus"] = plus_minus
    return environment
