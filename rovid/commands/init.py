"""``rovid init``."""

from __future__ import annotations

from typing import Annotated

import typer

from rovid.commands.manual import Page
from rovid.commands.options import Json, Logs
from rovid.commands.session import console, print_json

PAGE = Page(
    text="""
    Reads the logs and guesses which column or topic is the heading, which are thruster commands, in what unit and
    of what sense. Writes rovid.toml beside the logs, each guess with its reason as a comment; where there is no
    thrust curve also thrust_guess.csv. Lever arms, and such a curve, are marked there as guessed, and so is every
    number that hangs on them until the marks are gone.

    Use it first, on a new folder of logs. Then read rovid.toml, put in what was measured, and delete the marks.
    """,
    examples=(
        ("A first my_logs/rovid.toml", "rovid init my_logs"),
        ("Once more, from one log alone, over the one that is there", "rovid init my_logs/hold_01.csv --force"),
    ),
    see=("rovid check", "rovid help logs (formats)", "rovid help files (rovid.toml)"),
)


def init(
    logs: Logs,
    *,
    force: Annotated[
        bool, typer.Option("--force", help="Write over a rovid.toml that is there; without it that is an error.")
    ] = False,
    json: Json = False,
) -> None:
    """Write a first rovid.toml for your logs."""
    from rovid.ground.files import Claim
    from rovid.inspect.first_config import files_of, outputs_beside, survey
    from rovid.show.documents import survey_document
    from rovid.show.terminal import show_survey

    # A guessed curve that is there may be a bench curve by now, but it may not be needed either.
    config, _ = outputs_beside(logs)
    claim = Claim([config], force=force)
    surveyed = survey(logs)
    files = files_of(surveyed)
    claim.write(files)
    written = [output.path for output in files]
    if json:
        print_json(survey_document(surveyed, written))
    else:
        show_survey(console(), surveyed, written)
