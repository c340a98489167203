"""A small trial day in memory: simulated here, by the tests' own Runge-Kutta, and identified by rovid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.control.design import ControllerDesign
from rovid.core.array_types import FloatArray
from rovid.effects import Effect, effect_named
from rovid.estimate.inertia import fit_inertia
from rovid.estimate.steady_drag import fit_drag
from rovid.estimate.steady_points import steady_points
from rovid.model.simulation import TrialSimulation, fit_measures, simulate_runs
from rovid.present.page import build, render
from rovid.present.page.figures import ReportFigures, draw_figures
from rovid.present.report_data import NestedSimulation, ReportData
from rovid.store.parameter_file import Entry, Parameters
from rovid.store.study import Study, open_study
from rovid.trial.preprocessing import prepare
from rovid.trial.trial import Campaign, Remark, Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tests.conftest import blank_plots
from tools.hidden import Hidden
from tools.programme import CAMPAIGN
from tools.trial_day import write_trial_day
from tools.truth import ROSUB

INERTIA, QUADRATIC, LINEAR = 30.0, 40.0, 10.0
PERIOD = 0.05  # s between samples
ARM = 0.5  # m

Command = Callable[[FloatArray], FloatArray]


def drag(rate: float) -> float:
    return QUADRATIC * abs(rate) * rate + LINEAR * rate


def advance(rate: float, torque: float, step: float) -> float:
    """One classical Runge-Kutta step of the yaw rate."""

    def slope(r: float) -> float:
        return (torque - drag(r)) / INERTIA

    k1 = slope(rate)
    k2 = slope(rate + 0.5 * step * k1)
    k3 = slope(rate + 0.5 * step * k2)
    k4 = slope(rate + step * k3)
    return rate + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def turned(torque: FloatArray, disturbance: FloatArray) -> FloatArray:
    """Heading under a held torque, in steps well below the vehicle's time constant."""
    heading, rate, fine = [0.0], 0.0, PERIOD / 4.0
    for value in (torque + disturbance)[:-1]:
        angle = heading[-1]
        for _ in range(4):
            before = rate
            rate = advance(rate, float(value), fine)
            angle += 0.5 * fine * (before + rate)
        heading.append(angle)
    return np.array(heading)


def coloured(rng: np.random.Generator, count: int) -> FloatArray:
    """A disturbance torque with a memory of about a second."""
    values = np.zeros(count)
    for k in range(1, count):
        values[k] = 0.95 * values[k - 1] + 0.05 * rng.normal()
    return values


def trial(vehicle: Vehicle, name: str, seconds: float, command: Command, folder: Path, seed: int) -> Trial:
    rng = np.random.default_rng(seed)
    time: FloatArray = PERIOD * np.arange(round(seconds / PERIOD), dtype=np.float64)
    commands = np.column_stack([command(time)] * 2)
    torque = np.sum([t.torque(commands[:, k]) for k, t in enumerate(vehicle.thrusters)], axis=0)
    heading = turned(torque, coloured(rng, len(time))) + 1e-4 * rng.normal(size=len(time))
    return Trial(name=name, path=folder / "log.csv", time=time, position=heading, commands=commands)


def hold(level: float) -> Command:
    return lambda time: np.where(time > 2.0, level, 0.0)


def sine(amplitude: float, period: float) -> Command:
    return lambda time: amplitude * np.sin(2.0 * np.pi * time / period)


# Steady turns for a fit of quadratic and linear drag.
_MIN_HOLDS = 4

PROGRAMME: dict[str, tuple[float, Command]] = {
    **{f"hold_{k}.csv": (40.0, hold(level)) for k, level in enumerate((0.8, 1.6, 2.4, -0.8, -1.6, -2.4, 2.0, -2.0))},
    "sine_a.csv": (60.0, sine(2.0, 10.0)),
    "sine_b.csv": (60.0, sine(1.5, 6.0)),
    "step.csv": (30.0, lambda time: np.where(time % 12.0 < 6.0, 1.2, -0.4)),
}


def make_vehicle(name: str = "Test vehicle") -> Vehicle:
    command = np.linspace(-5.0, 5.0, 41)
    curve = ThrustCurve(command=command, thrust=np.where(command > 0, 6.0, 5.0) * np.abs(command) * command)
    thrusters = tuple(Thruster(name=each, arm=ARM, curve=curve) for each in ("fore", "aft"))
    return Vehicle(name=name, thrusters=thrusters, mass=100.0, length=1.2, width=0.8)


def make_evidence(folder: Path, names: dict[str, str] | None = None, vehicle: Vehicle | None = None) -> ReportData:
    """The whole day; ``names`` from a log of the programme to the name that it gets, and no other logs then."""
    vehicle = vehicle or make_vehicle()
    shown = names or {name: name for name in PROGRAMME}
    trials = tuple(trial(vehicle, shown[n], *PROGRAMME[n], folder, seed) for seed, n in enumerate(shown))
    return identified(vehicle, Campaign(trials=trials, sources=(folder,)), folder)


def identified(vehicle: Vehicle, campaign: Campaign, folder: Path) -> ReportData:
    runs = prepare(campaign, vehicle)
    points = steady_points(runs.items, vehicle)
    if len(points) < _MIN_HOLDS:  # Few logs are shown; the drag comes from the other holds of the day, too.
        others = [name for name in PROGRAMME if name.startswith("hold")]
        holds = tuple(trial(vehicle, name, *PROGRAMME[name], folder, seed) for seed, name in enumerate(others))
        points = [*points, *steady_points(prepare(Campaign(trials=holds, sources=()), vehicle).items, vehicle)]
    steady = fit_drag(points)
    stored = Parameters(path=folder / "parameters.toml").with_estimate(steady.estimate)
    inertia = fit_inertia(runs.items, drag=stored.independent_drag(), rigid_body=vehicle.rigid_body_inertia)
    stored = stored.with_estimate(inertia.estimate)
    return ReportData(
        vehicle=vehicle,
        parameters=stored,
        campaign=campaign,
        runs=runs,
        drag=steady,
        drag_refusal="",
        inertia=inertia,
        inertia_refusal="",
        simulations=tuple(simulate_runs(runs.items, stored.model(), vehicle)),
    )


def staged(day: ReportData) -> ReportData:
    """As if two causes had been found: without, with either, and with both, each with a smaller share of the error."""
    lag, bias = effect_named("thruster_lag"), effect_named("bias_torque")
    found: list[tuple[tuple[Effect, ...], tuple[float, ...]]] = [
        ((), ()),
        ((lag,), (0.3,)),
        ((bias,), (1.0,)),
        ((lag, bias), (0.3, 1.0)),
    ]
    plain, stages = day.parameters.model(), []
    for number, (effects, values) in enumerate(found, start=1):
        model = replace(plain, effects=effects, effect_values=values)
        stages.append(
            NestedSimulation(model=model, simulations=tuple(nearer(item, number) for item in day.simulations))
        )
    return replace(day, nested=tuple(stages))


def nearer(item: TrialSimulation, times: int) -> TrialSimulation:
    """``item`` so many times as near to the measurement."""
    simulated = item.measured + (item.simulated - item.measured) / times
    position = item.run.trial.position + (item.position - item.run.trial.position) / times
    ahead = {horizon: None if error is None else error / times for horizon, error in item.position_errors.items()}
    fit = fit_measures(item.measured, simulated)
    return replace(item, simulated=simulated, position=position, position_errors=ahead, fit=fit)


GAP = Remark(kind="gap", count=1, text="The heading is missing for 1.5 s from 12 s on.")


@pytest.fixture(scope="session")
def day(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    """Holds both ways, two sines and a step, identified."""
    return make_evidence(tmp_path_factory.mktemp("day"))


BIAS = Entry(value=1.0, standard_error=0.05, unit="N m", method="maximum likelihood")


def silent(_: str) -> None:
    """What `build` is given where nobody watches."""


def study_of(day: ReportData) -> Study:
    return Study(paths=(), vehicle=day.vehicle, campaign=day.campaign, runs=day.runs)


def designed(day: ReportData, **entries: Entry) -> ControllerDesign:
    stored = replace(day.parameters, entries={**day.parameters.entries, **entries})
    control, refusal = build.designed_control(study_of(day), stored, silent)
    assert control is not None, refusal
    return control


@pytest.fixture(scope="module")
def control(day: ReportData) -> ControllerDesign:
    return designed(day)


@pytest.fixture(scope="module")
def pushed(day: ReportData) -> ControllerDesign:
    return designed(day, **{"bias_torque.torque": BIAS})


SHORT = [run for run in CAMPAIGN if run.name in {"hold_03", "hold_05", "sine_20s", "steps", "multilevel"}]
LAG = Hidden(effect="thruster_lag", form="first_order", parameters={"time_constant": 0.8})


@pytest.fixture(scope="session")
def lagged_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("diagnosed")


@pytest.fixture(scope="session")
def reported(lagged_folder: Path) -> tuple[ReportData, ReportFigures]:
    """What `rovid report` makes of a short day with a hidden lag, its plots blank; its page is in ``lagged_folder``."""
    write_trial_day(lagged_folder / "day", seed=3, formats="csv", truth=replace(ROSUB, hidden=(LAG,)), campaign=SHORT)
    kept: list[tuple[ReportData, ReportFigures]] = []

    def draw(evidence: ReportData) -> ReportFigures:
        kept.append((evidence, draw_figures(evidence)))
        return kept[-1][1]

    said: list[str] = []
    with pytest.MonkeyPatch.context() as patch, blank_plots():
        patch.setattr(render, "draw_figures", draw)
        patch.chdir(lagged_folder)
        stored = Parameters(path=Path("parameters.toml"))
        study, folder = open_study([lagged_folder / "day"]), lagged_folder / "report"
        # Without a limit: a busy machine must not end the search.
        build.build_report(stored, study, folder, report=said.append, budget=3600.0)
    assert said[-1] == "Drawing and writing the page …"
    assert len(said) > 2
    return kept[0]


@pytest.fixture(scope="session")
def lagged(reported: tuple[ReportData, ReportFigures]) -> ReportData:
    """See ``reported``."""
    return reported[0]


@pytest.fixture(scope="session")
def lagged_album(reported: tuple[ReportData, ReportFigures]) -> ReportFigures:
    """See ``reported``."""
    return reported[1]
