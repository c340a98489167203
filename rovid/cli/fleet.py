"""``rovid fleet``."""

from pathlib import Path
from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import console, named_axis, print_json
from rovid.cli.options import Cutoff, Force, Json, argument, option
from rovid.cli.streams import progress


def fleet(
    folders: Annotated[list[Path], argument("FOLDERS", "Campaigns, or folders that contain campaigns at any depth.")],
    *,
    output: Annotated[Path, option("OUT", "Folder for the table, the page and the diagnoses.", "--output", "-o")],
    jobs: Annotated[
        int | None, option("N", "Number of campaigns at a time. Default: the number of cores.", min=1)
    ] = None,
    cluster: Annotated[str, option("ADDRESS", "Scheduler of a Dask cluster to use instead of this machine.")] = "",
    timeout: Annotated[float, option("SECONDS", "Time limit for each campaign in s.", min=1e-3)] = 3600.0,
    shrink: Annotated[
        bool, typer.Option("--shrink", help="Treat the vehicles as sisters: add hierarchical means to the table.")
    ] = False,
    axis: Annotated[
        str | None,
        option(
            "AXIS",
            "Degree of freedom: yaw, surge, sway, heave, roll or pitch. Default: yaw.",
            autocompletion=completion.axes,
        ),
    ] = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Diagnose many campaigns and summarise them."""
    from rovid.fleet.run import FleetOptions, fleet_document, run_fleet, show_fleet

    options = FleetOptions(
        axis=named_axis(axis).name, cutoff=cutoff, jobs=jobs, cluster=cluster, patience=timeout, shrink=shrink
    )
    with progress("Looking for campaigns …") as report:
        result = run_fleet(folders, output, options, force=force, report=report)
    if json:
        print_json(fleet_document(result))
    else:
        show_fleet(console(), result)
