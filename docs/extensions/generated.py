"""Page content generated from the program at build time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata
from typer.main import get_command

from rovid.cli.cli import app as rovid

_COMMANDS = "<!-- commands -->"
_COLUMNS = 84
# Pages that list the other pages of their folder.
_LISTED = ("effects/README", "faults/README")


def command_reference() -> str:
    """Help of every command as Markdown."""
    # Newer versions of typer contain their own copy of click, with incompatible types.
    group: Any = get_command(rovid)
    parent = group.context_class(group, info_name="rovid")
    return "\n".join(_help(command, parent) for command in group.commands.values())


def _help(command: Any, parent: Any) -> str:
    context = command.context_class(command, info_name=command.name, parent=parent, terminal_width=_COLUMNS)
    return f"## rovid {command.name}\n\n```text\n{command.get_help(context).strip()}\n```\n"


def _complete(app: Sphinx, name: str, source: list[str]) -> None:
    """Insert the generated parts into a page."""
    if name == "commands":
        source[0] = source[0].replace(_COMMANDS, command_reference())
    elif name in _LISTED:
        # The page is also read outside Sphinx, where a table of contents would appear as text.
        folder = Path(app.srcdir, name).parent
        pages = "\n".join(sorted({page.stem for page in folder.glob("*.md")} - {"README"}))
        source[0] += f"\n```{{toctree}}\n:hidden:\n\n{pages}\n```\n"


def setup(app: Sphinx) -> ExtensionMetadata:
    """Connect the handler to the reading of pages."""
    app.connect("source-read", _complete)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
