"""The command line: which commands there are, and how a run of one ends. What a command needs it imports itself."""

from __future__ import annotations

import errno
import functools
import os
import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Annotated

import typer
from typer.main import get_command

from rovid import __version__
from rovid.cli.help_format import FIRST_SESSION, ManualCommand, ManualGroup, Page
from rovid.core import process_tuning
from rovid.core.errors import RovidError, display_text

# The file of each command, called as it is, in the order of the help: it holds the command and its page of the manual.
COMMANDS = (
    "init",
    "check",
    "convert",
    "fit_drag",
    "fit_inertia",
    "fit",
    "diagnose",
    "compare",
    "fit_thruster",
    "simulate",
    "plan",
    "watch",
    "control",
    "export",
    "report",
    "open",
    "fleet",
    "help",
)
_MODULES = {name.replace("_", "-"): import_module(f"rovid.cli.{name}") for name in COMMANDS}
MANUAL: dict[str, Page] = {name: module.PAGE for name, module in _MODULES.items()}

app = typer.Typer(
    cls=ManualGroup,
    help="From an underwater vehicle's trial logs to a dynamic model its owner can defend.",
    epilog=FIRST_SESSION,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # boxes leave no room for words at 80 columns
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def main() -> None:
    """Entry point: run the command; the user's mistakes end with one message and exit status 2."""
    # Before numpy is imported: products of matrices are small here, and BLAS's own threads get in each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    process_tuning.tune_process()
    if "_ROVID_COMPLETE" in os.environ:
        # typer folds the help that zsh and fish show beside a value; a shell takes each line for a value.
        os.environ["COLUMNS"] = "1000"
    try:
        _command()(prog_name="rovid")
    except RovidError as error:
        sys.stderr.write(f"rovid: {error}\n")
        raise SystemExit(2) from None
    except BrokenPipeError:
        # The reader of our output went away, as `| head` does.
        sys.stderr.close()
        raise SystemExit(1) from None
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        sys.stderr.write(f"rovid: {_too_long(error.filename)}\n")
        raise SystemExit(2) from None


@functools.cache
def _command() -> Callable[..., object]:
    """Every command's parameters are looked at; once, however often a process calls `main`."""
    return get_command(app)


def _too_long(name: object) -> str:
    return f"{display_text(str(name))}: there is no such file or folder: no file's name is as long. Give a shorter one."


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


def _register(name: str, command: ModuleType) -> None:
    run, page = getattr(command, name.replace("-", "_")), MANUAL[name]
    # The docstring says in a line what the command does, the manual says the rest.
    app.command(name, cls=ManualCommand, help=f"{run.__doc__}\n{page.text}", epilog=page.epilog)(run)


for _name, _module in _MODULES.items():
    _register(_name, _module)
