"""``rovid help``."""

from __future__ import annotations

from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import console, print_json
from rovid.cli.help_format import Page
from rovid.cli.options import Json

PAGE = Page(
    text="""
    Prints a page of the documentation: how to do a thing, what a file holds, what an effect does to a vehicle and
    how it is told from others. Of a command it prints the manual and, where there is one, the page on its task.
    Without TOPIC it lists what there is. Reads and writes no file of yours.

    Use it where there is no network: the pages come with rovid.
    """,
    examples=(
        ("What there is to read", "rovid help"),
        ("An effect: its equation, what it is confused with, typical sizes", "rovid help thruster_lag"),
        ("The formats of logs", "rovid help logs"),
    ),
    see=("rovid COMMAND --help",),
)


def help(  # noqa: A001 - the command's own name
    context: typer.Context,
    topic: Annotated[
        str | None,
        typer.Argument(
            metavar="TOPIC",
            help="A page, an effect or a command; all are listed if not given.",
            autocompletion=completion.topics,
            show_default=False,
        ),
    ] = None,
    *,
    json: Json = False,
) -> None:
    """Print a page of the documentation."""
    from rovid.present.terminal.topic_page import show_topic, show_topics
    from rovid.present.terminal.topics import topic_names, topic_text, topic_title

    manual = _manual(context, topic)
    pages = topic_names()
    if json and topic is None:
        print_json({"schema": "rovid-help/1", "topics": {name: topic_title(name) for name in pages}})
    elif json:
        page = topic_text(topic or "") if manual is None or topic in pages else ""
        print_json({"schema": "rovid-help/1", "topic": topic, "manual": manual, "text": page})
    elif topic is None:
        show_topics(console())
    else:
        if manual is not None:
            typer.echo(f"{manual}\n")
        if manual is None or topic in pages:
            show_topic(console(), topic)


def _manual(context: typer.Context, name: str | None) -> str | None:
    """The page of a command, as --help prints it."""
    group = context.parent.command if context.parent else None
    command = getattr(group, "commands", {}).get(name)
    if command is None:
        return None
    own = type(context)(command, info_name=name, parent=context.parent)
    return str(command.get_help(own)).rstrip()
