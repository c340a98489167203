"""The manual: what a page of it holds, and how it is set, as plain text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from typer.core import TyperCommand, TyperGroup

_EXIT = """\
Exit status:
  0  Done.
  2  The input cannot be used. One message says where, what was found, what
     was wanted and how to mend it."""


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
    """A command whose help looks like a page of a manual: `LOGS...` for names, the epilog printed as it stands."""

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
        formatter.write(f"\n{self.epilog}\n")


class ManualGroup(TyperGroup):
    """All commands; the epilog printed as it stands."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002, D102 - typer's
        formatter.write(f"\n{self.epilog}\n")


def _is_argument(parameter: Any) -> bool:
    # Some versions of typer bring a click of their own: its classes are not everybody's.
    return bool(parameter.param_type_name == "argument")


FIRST_SESSION = """\
A first session, with the sample logs of the source folder:
  rovid check sample_logs/rosub_tank
  rovid fit-drag sample_logs/rosub_tank
  rovid fit-inertia
  rovid diagnose
  rovid report

Your own logs begin with `rovid init LOGS`. `rovid COMMAND --help` explains a
command, with examples. `rovid --install-completion` makes the Tab key complete
commands, options, effects, axes and formats."""
