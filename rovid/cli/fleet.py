"""``rovid fleet``."""

from pathlib import Path
from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import console, named_axis, print_json
from rovid.cli.options import Cutoff, Force, Json, Page, argument, option
from rovid.cli.streams import progress

PAGE = Page(
    text="""
    Diagnoses many campaigns on all cores, each in a process of its own. A folder with a rovid.toml is a campaign. Any
    other folder is searched for campaigns. Writes into the output folder: fleet.parquet with one row a campaign;
    index.html with findings over time, the history of each parameter, changes of causes and outliers; and
    campaigns/NAME.json with each diagnosis. A campaign that cannot be diagnosed has its error in its row.

    A second start continues an interrupted run. A campaign is diagnosed again only if its logs, its rovid.toml or the
    version of rovid changed. Requires the extra: pip install 'rovid[fleet]'.
    """,
    examples=(
        ("Every campaign below a folder", "rovid fleet my_campaigns -o fleet"),
        ("Two seasons, with hierarchical means over vehicles of one type", "rovid fleet 2025 2026 -o fleet --shrink"),
        (
            "On a Dask cluster with access to the same folders",
            "rovid fleet my_campaigns -o fleet --cluster tcp://host:8786",
        ),
    ),
    see=("rovid diagnose", "rovid report", "rovid help fleet"),
)


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
