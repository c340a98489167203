"""The command line: the list of commands and the end of a run. Each command imports its own modules."""

import contextlib
import functools
import os
import sys
import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer
from typer.main import get_command

from rovid import __version__
from rovid.cli.context import console, print_json
from rovid.cli.options import FIRST_SESSION, ManualCommand, ManualGroup, Page, described
from rovid.cli.streams import machine_error, prepare_streams
from rovid.core import threads
from rovid.core.errors import RovidError

# The manual pages in the order of the help. A command is a function in the module of its name, or of `_MODULES`.
MANUAL = {
    name: Page(**page)
    for name, page in tomllib.loads(Path(__file__).with_name("manual.toml").read_text(encoding="utf-8")).items()
}

app = typer.Typer(
    cls=ManualGroup,
    help="From trial logs of an underwater vehicle to a dynamic model with known accuracy.",
    epilog=FIRST_SESSION,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # The boxes of rich leave no room for words at 80 columns.
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def main() -> None:
    """Run the command; a user error ends with one message and exit status 2."""
    # Before numpy is imported: the matrices are small, and threads of BLAS would compete with ours.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    threads.tune_process()
    prepare_streams()
    if "_ROVID_COMPLETE" in os.environ:
        # typer wraps the help texts that zsh and fish show, and a shell would read each line as a value.
        os.environ["COLUMNS"] = "1000"
    output = sys.stdout
    try:
        try:
            _command()(prog_name="rovid")
        finally:
            output.flush()
    except RovidError as error:
        sys.stderr.write(f"rovid: {error}\n")
        raise SystemExit(2) from None
    except (BrokenPipeError, SystemExit) as end:
        # typer answers a broken pipe with a wrapper of the output, and with status 1.
        if isinstance(end, SystemExit) and sys.stdout is output:
            raise
        # The reader of the output ended, as `| head` does. What is left in the buffer would fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), output.fileno())
        raise SystemExit(0) from None
    except (OSError, MemoryError, ImportError, RuntimeError) as error:
        message = machine_error(error)
        if not message:
            raise
        sys.stderr.write(f"rovid: {message}\n")
        if isinstance(error, OSError) and error.filename is None:
            # What is left in the buffer of a full device would fail again at the end of the process.
            with contextlib.suppress(OSError):
                sys.stdout.close()
        raise SystemExit(2) from None


@functools.cache
def _command() -> Callable[..., object]:
    return get_command(app)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"rovid {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    pass


def help(  # noqa: A001 - the command's own name
    context: typer.Context, words: list[str] | None = None, *, json: bool = False
) -> None:
    """Print a page of the documentation."""
    from rovid.present.terminal.topics import show_page_or_passages, show_topics, topic_names, topic_text, topic_title

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
            show_page_or_passages(console(), topic)


def _manual(context: typer.Context, name: str | None) -> str | None:
    """The manual page of a command, as --help prints it."""
    group = context.parent.command if context.parent else None
    command = getattr(group, "commands", {}).get(name)
    if command is None:
        return None
    own = type(context)(command, info_name=name, parent=context.parent)
    return str(command.get_help(own)).rstrip()


# Commands that share a module with others -> that module.
_MODULES = {
    **dict.fromkeys(("open", "mcp"), "report"),
    **dict.fromkeys(("fit-drag", "fit-inertia", "fit-thruster", "fit-thrust-scale"), "fit"),
    **dict.fromkeys(("diagnose", "effect", "discover"), "fit"),
    **dict.fromkeys(("simulate", "plan", "control", "export"), "models"),
    **dict.fromkeys(("init", "check", "convert", "compare", "fleet", "watch"), "campaigns"),
    "help": "cli",
}
for _name, _page in MANUAL.items():
    _function = _name.replace("-", "_")
    _run = described(_name, getattr(import_module(f"rovid.cli.{_MODULES.get(_name, _function)}"), _function))
    # The docstring is the first line of the help.
    app.command(_name, cls=ManualCommand, help=f"{_run.__doc__}\n\n{_page.text}", epilog=_page.epilog)(_run)
