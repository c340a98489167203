"""``rovid fit-thruster``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rovid.cli import completion
from rovid.cli.context import console, print_json
from rovid.cli.help_format import Page
from rovid.cli.options import Force, Json
from rovid.core.errors import ConfigError, suggestion

PAGE = Page(
    text="""
    Reads a CSV of bench readings: a column of command and one of thrust, found by their names, or the first two
    where there is no header. Fits a curve that only rises and keeps its dead zone, and writes it with the columns
    command,thrust_N, ready for rovid.toml. The command keeps its unit.

    Use it where the bench gave scattered readings rather than a curve.
    """,
    examples=(
        (
            "Readings without a header, in newtons",
            "rovid fit-thruster bench.csv --unit N",
        ),
        (
            "A maker's table, into a named file",
            "rovid fit-thruster t200_bench.csv -o t200.csv",
        ),
    ),
    see=("rovid init", "rovid check"),
)


def fit_thruster(
    bench: Annotated[Path, typer.Argument(metavar="BENCH", help="A CSV file with readings of command and thrust.")],
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Where the curve goes; BENCH_curve.csv in the working folder if not given.",
            show_default=False,
        ),
    ] = None,
    command: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="Column of the command; found by its name if not given.", show_default=False
        ),
    ] = None,
    thrust: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="Column of the thrust; found by its name if not given.", show_default=False
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT",
            help=f"Unit of the thrust: {', '.join(completion.THRUST_UNITS)}; that in the column's name if not given.",
            autocompletion=completion.thrust_units,
            show_default=False,
        ),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Make a thrust curve from bench readings."""
    from rovid.core.atomic_write import OutputFile, OutputSet
    from rovid.core.signatures import CURVE
    from rovid.estimate.thrust_curve import THRUST_UNITS, bench_readings, fit_thrust_curve
    from rovid.present.documents.fits import bench_document
    from rovid.present.terminal.results import show_bench
    from rovid.trial.tables import CURVE_COLUMNS, curve_csv, read_table

    if unit is not None and unit not in THRUST_UNITS:
        also = {"newton": "N", "kilonewton": "kN", "kg": "kgf", "g": "gf", "lb": "lbf", "pound": "lbf"}
        raise ConfigError(f"is {unit!r}. {suggestion(unit, THRUST_UNITS, also)}", where="--unit")
    target = output or Path(f"{bench.stem}_curve.csv")
    curve = OutputFile(target, CURVE)
    claim = OutputSet([curve], force=force, protected=[bench])
    readings = bench_readings(read_table(bench, headerless=CURVE_COLUMNS), command=command, thrust=thrust, unit=unit)
    result = fit_thrust_curve(*readings)
    claim.write({curve: curve_csv(result.curve.command, result.curve.thrust)})
    if json:
        print_json(bench_document(result, str(target)))
    else:
        show_bench(console(), result, target)
