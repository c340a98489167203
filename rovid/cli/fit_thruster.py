"""``rovid fit-thruster``."""

from pathlib import Path
from typing import Annotated

from rovid.cli import completion
from rovid.cli.context import console, print_json
from rovid.cli.options import Force, Json, argument, option
from rovid.core.errors import ConfigError, suggestion


def fit_thruster(
    bench: Annotated[Path, argument("BENCH", "A CSV file of measured commands and thrusts.")],
    *,
    output: Annotated[
        Path | None, option("FILE", "The new file. Default: BENCH_curve.csv in the working folder.", "--output", "-o")
    ] = None,
    command: Annotated[str | None, option("COLUMN", "Column of the command. Default: found by its name.")] = None,
    thrust: Annotated[str | None, option("COLUMN", "Column of the thrust. Default: found by its name.")] = None,
    unit: Annotated[
        str | None,
        option(
            "UNIT",
            f"Unit of the thrust: {', '.join(completion.THRUST_UNITS)}. Default: the unit in the column's name.",
            autocompletion=completion.thrust_units,
        ),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Fit a thrust curve to bench measurements."""
    from rovid.core.output_files import CURVE, OutputFile, OutputSet
    from rovid.estimate.thrust_curve import THRUST_UNITS, bench_readings, fit_thrust_curve
    from rovid.present.documents.fits import bench_document
    from rovid.present.terminal.results import show_bench
    from rovid.trial.tables import CURVE_COLUMNS, curve_csv, read_table

    if unit is not None and unit not in THRUST_UNITS:
        synonyms = {"newton": "N", "kilonewton": "kN", "kg": "kgf", "g": "gf", "lb": "lbf", "pound": "lbf"}
        raise ConfigError(f"is {unit!r}. {suggestion(unit, THRUST_UNITS, synonyms)}", where="--unit")
    curve = OutputFile(output or Path(f"{bench.stem}_curve.csv"), CURVE)
    outputs = OutputSet([curve], force=force, protected=[bench])
    table = read_table(bench, headerless=CURVE_COLUMNS)
    result = fit_thrust_curve(*bench_readings(table, command=command, thrust=thrust, unit=unit))
    outputs.write({curve: curve_csv(result.curve.command, result.curve.thrust)})
    if json:
        print_json(bench_document(result, str(curve.path)))
    else:
        show_bench(console(), result, curve.path)
