"""``rovid fleet``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import console, print_json, working
from rovid.cli.help_format import Page
from rovid.cli.options import Cutoff, Force, Json

PAGE = Page(
    text="""
    Diagnoses many campaigns, each in a process of its own, on all cores. A folder that holds a rovid.toml is a
    campaign; one that does not is looked through for those that do. Writes into the folder of -o: fleet.parquet, one
    row a campaign; index.html, with vehicles over time, each parameter's history, causes that come and go, and what
    is out of line; campaigns/NAME.json, each diagnosis whole. What cannot be diagnosed has its error in its row.

    Started again it goes on where it was stopped: what is done is not done again, unless its logs, rovid.toml or
    rovid's version changed. Wants the extra: pip install 'rovid[fleet]'.
    """,
    examples=(
        ("Every campaign below a folder", "rovid fleet my_campaigns -o fleet"),
        ("Two seasons, and vehicles of one type told by each other", "rovid fleet 2025 2026 -o fleet --shrink"),
        ("On a Dask cluster that sees the same folders", "rovid fleet my_campaigns -o fleet --cluster tcp://host:8786"),
    ),
    see=("rovid diagnose", "rovid report", "rovid help fleet"),
)


def fleet(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDERS", help="Campaigns, or folders that hold campaigns at any depth.", show_default=False
        ),
    ],
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT", help="Folder for the table, the page and each diagnosis.")
    ],
    jobs: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Campaigns at a time; as many as there are cores if not given.", show_default=False
        ),
    ] = None,
    cluster: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS", help="Scheduler of a Dask cluster, in the place of this machine.", show_default=False
        ),
    ] = "",
    timeout: Annotated[
        float, typer.Option(metavar="SECONDS", min=1e-3, help="What a campaign may take; then it is given up.")
    ] = 3600.0,
    shrink: Annotated[
        bool,
        typer.Option("--shrink", help="Take the vehicles for sisters: columns of what each is by the others' help."),
    ] = False,
    axis: Annotated[
        str | None,
        typer.Option(
            metavar="AXIS",
            help="Degree of freedom: yaw, surge, sway, heave, roll or pitch; yaw if not given.",
            autocompletion=completion.axes,
            show_default=False,
        ),
    ] = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Diagnose many campaigns: a table and a page."""
    from rovid.fleet.output import fleet_document, show_fleet
    from rovid.fleet.run import FleetOptions, run_fleet
    from rovid.trial.axis import axis_named

    options = FleetOptions(
        axis=axis_named(axis).name if axis else "yaw",
        cutoff=cutoff,
        jobs=jobs,
        cluster=cluster,
        patience=timeout,
        shrink=shrink,
    )
    with working("Looking for campaigns …") as report:
        written = run_fleet(folders, output, options, force=force, report=report)
    if json:
        print_json(fleet_document(written))
    else:
        show_fleet(console(), written)
