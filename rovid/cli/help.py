"""``rovid help``."""

from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import console, print_json
from rovid.cli.options import Json, argument


def help(  # noqa: A001 - the command's own name
    context: typer.Context,
    words: Annotated[
        list[str] | None,
        argument("TOPIC", "A page, an effect or a command. Default: list all.", autocompletion=completion.topics),
    ] = None,
    *,
    json: Json = False,
) -> None:
    """Print a page of the documentation."""
    from rovid.present.terminal.topic_page import show_topic, show_topics
    from rovid.present.terminal.topics import topic_names, topic_text, topic_title

    topic = " ".join(words) if words else None
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
