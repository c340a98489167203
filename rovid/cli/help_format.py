"""The manual: what a page of it holds, and how it is set, as plain text."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from typing import Any

from typer.core import TyperCommand, TyperGroup

_EXIT = """\
Exit status:
  0  Done.
  2  The input cannot be used. One message says where, what was found, what was wanted and how to mend it."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """One command's page, but for what it does in a line, which is the docstring of its function.

    Attributes
    ----------
    text
        What it reads, what it writes, when to use it; paragraphs.
    examples
        (what for, command line); see ``tests/commands/test_manual.py``, which runs them.
    see
        Related commands and pages.
    """

    text: str
    examples: tuple[tuple[str, str], ...]
    see: tuple[str, ...]

    @property
    def epilog(self) -> str:
        """Examples, exit status and related commands, as they are to be printed."""
        examples = "\n\n".join(f"  # {what}\n  {line}" for what, line in self.examples)
        return f"Examples:\n{examples}\n\n{_EXIT}\n\nSee also:\n  {', '.join(self.see)}"


class ManualCommand(TyperCommand):
    """A command whose help looks like a page of a manual: `LOGS...` for names, the epilog in its own lines."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: D102 - typer's
        # Some versions of typer put names that are required into braces.
        return [piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: D102 - typer's
        own: list[Any] = list(self.get_params(ctx))
        arguments = [(one.metavar or one.name, one.help or "") for one in own if _is_argument(one)]
        options = [one.get_help_record(ctx) for one in own if not _is_argument(one)]
        for heading, rows in (("Arguments", arguments), ("Options", options)):
            if rows:
                with formatter.section(heading):
                    formatter.write_dl([row for row in rows if row])

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002, D102 - typer's
        formatter.write(f"\n{_set(self.epilog or '', formatter.width)}\n")


class ManualGroup(TyperGroup):
    """All commands, each with all of its line; the epilog in its own lines."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002, D102 - typer's
        with formatter.section("Commands"):
            formatter.write_dl([(name, (one.help or "").partition("\n")[0]) for name, one in self.commands.items()])

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002, D102 - typer's
        formatter.write(f"\n{_set(self.epilog or '', formatter.width)}\n")


def _set(text: str, width: int) -> str:
    """``text`` in its own lines, those that are longer than ``width`` folded below their beginning."""
    return "\n".join(_fold(line, width) for line in text.splitlines())


def _fold(line: str, width: int) -> str:
    if len(line) <= width:
        return line
    # Below the words, not below a sign or a number ahead of them.
    begins = re.match(r"\s*(?:[#\d]\s+)?", line)
    indent = " " * (begins.end() if begins else 0)
    # A shell goes on behind a backslash.
    command = line.startswith("  rovid ") and "," not in line
    end = " \\" if command else ""
    folded = textwrap.wrap(
        line,
        width - len(end),
        subsequent_indent=indent + "  " if command else indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return f"{end}\n".join(folded)


def _is_argument(parameter: Any) -> bool:
    # Some versions of typer bring a click of their own: its classes are not everybody's.
    return bool(parameter.param_type_name == "argument")


FIRST_SESSION = """\
A first session, with a folder of logs of yours:
  rovid init my_logs
  # now read my_logs/rovid.toml, and put your numbers in
  rovid check my_logs
  rovid fit-drag my_logs
  rovid fit-inertia
  rovid diagnose
  rovid report

`rovid COMMAND --help` explains a command, with examples; `rovid help` lists pages that tell how a thing is done, what \
a file holds, what each effect does. `rovid --install-completion` makes the Tab key complete commands, options, \
effects, axes and formats."""
