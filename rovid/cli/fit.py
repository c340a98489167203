"""``rovid fit-drag``, ``fit-inertia``, ``fit``, ``fit-thruster`` and ``fit-thrust-scale``."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rovid.cli.context import compile_in_background, console, existing_parameters, is_planar, print_json
from rovid.cli.options import SharedOptions
from rovid.cli.sessions import fit_and_store, open_planar_session, open_session, print_result, store_planar_fit
from rovid.cli.streams import progress
from rovid.core.errors import ConfigError, suggestion

if TYPE_CHECKING:
    from rovid.cli.sessions import FitSession
    from rovid.estimate.drives import ThrustScale
    from rovid.store.parameter_file import Parameters
    from rovid.store.study import Study
    from rovid.trial.vehicle import Vehicle


def fit_drag(logs: list[Path], *, shared: SharedOptions) -> None:
    """Fit drag from steady turns."""
    from rovid.preflight.check import drag_without_feedback

    session = open_session(logs, shared)
    if session.stored.axis.self_righting:
        # Under a constant torque such an axis comes to rest, so drag is found together with the inertia.
        _fit_inertia(session, json=shared.json)
        return
    fit_and_store(session, "Fitting drag …", partial(drag_without_feedback, session.study), json=shared.json)


def fit_inertia(logs: list[Path] | None = None, *, shared: SharedOptions) -> None:
    """Fit inertia from sines by four methods."""
    _fit_inertia(open_session(logs, shared), json=shared.json)


def _fit_inertia(session: FitSession[Study], *, json: bool) -> None:
    drag = session.stored.independent_drag()
    fit_and_store(session, "Fitting inertia …", lambda: session.study.inertia(drag), json=json)


def fit(
    logs: list[Path] | None = None, *, effect: list[str] | None = None, gyro: bool = False, shared: SharedOptions
) -> None:
    """Fit all parameters by maximum likelihood."""
    names = list(dict.fromkeys(effect or ()))
    if is_planar(shared, gyro=gyro):
        from rovid.store.planar_study import planar_effect

        chosen = tuple(dict.fromkeys(map(planar_effect, names)))
        coupled = open_planar_session(logs, shared)
        with progress("Fitting surge, sway and yaw …"):
            result = coupled.study.fit(chosen)
        warnings = (*result.estimate.warnings, *coupled.notes)
        result = replace(result, estimate=replace(result.estimate, warnings=warnings))
        stored = store_planar_fit(coupled, result)
        print_result(result, coupled.study, stored, json=shared.json)
        return
    compile_in_background()
    from rovid.effects import effect_named

    effects = tuple(map(effect_named, names))
    session = open_session(logs, shared, with_history=True)
    text = "Maximising the likelihood …"
    fit_and_store(
        session, text, lambda: session.study.likelihood(effects, gyro=gyro), *["--gyro"] * gyro, json=shared.json
    )


def fit_thruster(
    bench: Path,
    *,
    output: Path | None = None,
    command: str | None = None,
    thrust: str | None = None,
    unit: str | None = None,
    force: bool = False,
    json: bool = False,
) -> None:
    """Fit a thrust curve to bench measurements."""
    from rovid.core.output_files import CURVE, OutputFile, OutputSet
    from rovid.estimate.drives import THRUST_UNITS, bench_readings, fit_thrust_curve
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


def fit_thrust_scale(
    tests: Path | None = None,
    *,
    before: Path | None = None,
    after: Path | None = None,
    added: float | None = None,
    reference_error: float = 1.0,
    json: bool = False,
) -> None:
    """Estimate the common scale of all thrust from a pull, a lift or a step of inertia."""
    from rovid.estimate.drives import scale_from_step
    from rovid.present.documents.fits import thrust_scale_document
    from rovid.present.terminal.results import show_thrust_scale

    given = 1.0
    if tests is not None and before is None and after is None and added is None:
        scale, given = _of_tests(tests, reference_error / 100.0)
    elif tests is None and before is not None and after is not None and added is not None:
        (first, one), (second, two) = (
            (path, existing_parameters(SharedOptions(parameters=path))) for path in (before, after)
        )
        given, pairs = _common_scale(one, two), []
        for path, stored in ((first, one), (second, two)):
            if "inertia" not in stored.entries:
                raise ConfigError("holds no inertia.", where=path, mend="Run `rovid fit` with -p for this file.")
            pairs.append((stored.entries["inertia"].value, stored.entries["inertia"].standard_error))
        scale = scale_from_step(pairs[0], pairs[1], added, reference_error / 100.0)
    else:
        text = "TESTS, or --before, --after and --added together, were expected."
        raise ConfigError(text, where="rovid fit-thrust-scale", mend="See `rovid fit-thrust-scale --help`.")
    if json:
        print_json(thrust_scale_document(scale, given))
    else:
        show_thrust_scale(console(), scale, given)


def _common_scale(before: Parameters, after: Parameters) -> float:
    """The scale of the thrust that both files rest on. Raises ConfigError if their thrusts differ."""
    if before.settings is None or after.settings is None:
        return 1.0
    if differences := before.settings.changes(after.settings, drive_alone=True):
        text = f"rests on another thrust than {before.path}: {'; '.join(differences)}."
        mend = "Fit both with the same thrusters and thrust_scale in rovid.toml."
        raise ConfigError(text, where=after.path, mend=mend)
    if "thrust_scale_error" not in after.settings.drive:
        return 1.0
    from rovid.trial.config import find_config, load_config

    vehicle: Vehicle = load_config(find_config(after.logs)).vehicle
    return vehicle.thrust_scale


def _of_tests(path: Path, reference_error: float) -> tuple[ThrustScale, float]:
    """The scale by a table of pulls or lifts, and the scale that rovid.toml has already."""
    import numpy as np

    from rovid.estimate.drives import scale_from_lifts, scale_from_pulls
    from rovid.trial.config import find_config, load_config_of_any_axis
    from rovid.trial.tables import PULL_COLUMNS, read_table

    config, table = load_config_of_any_axis(find_config([path])), read_table(path)
    vehicle: Vehicle = config.vehicle
    columns = {
        thruster: [name for name in (signal.sources.get("csv", ""), thruster.name) if name in table.header][:1]
        for thruster, signal in zip(vehicle.thrusters, config.commands, strict=True)
        if thruster.curve is not None
    }
    measured = [name for name in PULL_COLUMNS if name in table.header]
    if len(measured) != 1 or not any(columns.values()):
        wanted = [signal.sources.get("csv", signal.name) for signal in config.commands]
        text = f"has the columns {', '.join(table.header)}; one of force_N, weight_N and torque_Nm, and commands "
        text += f"({', '.join(wanted)}) were expected."
        raise ConfigError(text, where=path, mend=suggestion(measured[0] if measured else "force_N", table.header))
    if (in_torque := measured[0] == "torque_Nm") and not config.axis.angular:
        text = f"torque_Nm is no force, and rovid.toml describes {config.axis.name}."
        raise ConfigError(text, where=path, mend="Give force_N or weight_N.")
    # A force is along the axis of a vehicle that moves along one, else along the thrusters.
    along = in_torque or not config.axis.angular
    thrust = np.zeros(len(table.rows))
    for thruster, (name, *_) in ((one, found) for one, found in columns.items() if found):
        command, curve = table.numbers(name), thruster.curve
        if curve is None:  # Left out above.
            continue
        if curve.excess(command):
            low, high = curve.command[[0, -1]]
            text = f"{name} leaves the curve of {thruster.name}, which ends at {low:g} and {high:g}."
            raise ConfigError(text, where=path, mend="Delete these rows, or extend the curve.")
        thrust += (thruster.arm if along else 1.0) * curve(command)
    fit = scale_from_lifts if measured[0] == "weight_N" else scale_from_pulls
    return fit(thrust, table.numbers(measured[0]), reference_error), vehicle.thrust_scale
