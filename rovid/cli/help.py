"""``rovid help``."""

from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import console, print_json
from rovid.cli.options import Json, Page, argument

PAGE = Page(
    text="""
    Prints a page of the documentation: how to do a task, the content of a file, or a physical effect and how to
    distinguish it from others. For a command it prints the manual page and the page on its task, if there is one.
    Without TOPIC it lists all pages. Reads and writes none of your files.

    Use it without a network connection: the pages are installed with rovid.
    """,
    examples=(
        ("List of the pages", "rovid help"),
        ("An effect: its equation, similar effects, typical sizes", "rovid help thruster_lag"),
        ("Formats of logs", "rovid help logs"),
    ),
    see=("rovid COMMAND --help",),
)


def help(  # noqa: A001 - the command's own name
    context: typer.Context,
    topic: Annotated[
        str | None,
        argument("TOPIC", "A page, an effect or a command. Default: list all.", autocompletion=completion.topics),
    ] = None,
    *,
    json: Json = False,
) -> None:
    """Print a page of the documentation."""
    from rovid.present.terminal.topic_page import show_topic, show_topics
    from rovid.present.terminal.topics import topic_names, topic_text, topic_title

    manual = _manual(context, topic)
    pages = topic_names()
    has_page = manual is None or topic in pages
    if json and topic is None:
        print_json({"schema": "rovid-help/1", "topics": {name: topic_title(name) for name in pages}})
    elif json:
        text = topic_text(topic or "") if has_page else ""
        print_json({"schema": "rovid-help/1", "topic": topic, "manual": manual, "text": text})
    elif topic is None:
        show_topics(console())
    else:
        if manual is not None:
            typer.echo(f"{manual}\n")
        if has_page:
            show_topic(console(), topic)


def _manual(context: typer.Context, name: str | None) -> str | None:
    """The manual page of a command, as --help prints it."""
    group = context.parent.command if context.parent else None
    command = getattr(group, "commands", {}).get(name)
    if command is None:
        return None
    own = type(context)(command, info_name=name, parent=context.parent)
    return str(command.get_help(own)).rstrip()
