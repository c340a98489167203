"""A study: logs of a folder, or arrays in memory, and what can be asked of them. Nothing is written or printed."""

from __future__ import annotations

import contextlib
import importlib
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Self

from rovid.api import records
from rovid.api import results as to
from rovid.compare.campaign_fit import CampaignFit, campaign_from_study
from rovid.compare.comparison import compare as compare_campaigns
from rovid.core.budget import ProgressCallback
from rovid.core.errors import ConfigError, DataError
from rovid.diagnose.result import Diagnosis
from rovid.effects import Effect, effect_named
from rovid.estimate.candidate_runs import RunLimits
from rovid.export.interface import export_input
from rovid.export.planar_input import planar_input
from rovid.export.verification import select_exporter, verified_export
from rovid.preflight.check import check_logs, check_trials, require_fittable, reversed_thrusters
from rovid.preflight.planar_check import check_planar, check_planar_trials
from rovid.readers.campaign import campaign_of
from rovid.readers.parquet_reader import Table, thrust_curve, trials_of
from rovid.store.parameter_file import Parameters
from rovid.store.planar_study import PlanarStudy, open_planar_study, planar_effect, planar_study_of
from rovid.store.study import Study, open_study, study_of
from rovid.trial.axis import PLANAR, YAW, Axis, axis_named
from rovid.trial.config import Config, config_from, find_config, load_config
from rovid.trial.trial import Trial


@contextlib.contextmanager
def notebook_progress(first: str) -> Iterator[ProgressCallback]:
    """A function that shows a line below the running cell, ``first`` and then others; silent outside a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if not hasattr(shell, "kernel"):  # as in a script or in IPython's terminal
        yield lambda _: None
        return
    display = importlib.import_module("IPython.display").display
    shown = display({"text/plain": first}, raw=True, display_id=True)
    try:
        yield lambda line: shown.update({"text/plain": line}, raw=True)
    finally:
        shown.update({"text/plain": ""}, raw=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class VehicleStudy:
    """A vehicle with its logs or arrays; made by `rovid.open` or by `from_frame`.

    Logs are read when they are first needed. Every method computes anew and returns a record.
    """

    paths: tuple[Path, ...] = ()  #: The folder or log that was opened; empty for data in memory.
    axis: Axis = YAW  #: `PLANAR` for surge, sway and yaw together.
    cutoff: float | None = None  #: Hz; None: chosen from the data.
    config: Config | None = None  #: Description of data in memory; None for logs.
    trials: tuple[Trial, ...] = ()  #: Data in memory.

    @classmethod
    def from_frame(
        cls,
        data: Table,
        *,
        signals: Mapping[str, Any],
        thrusters: Sequence[Mapping[str, Any]] = (),
        rudders: Sequence[Mapping[str, Any]] = (),
        vehicle: Mapping[str, Any] | None = None,
        run: str | None = None,
        axis: str = "yaw",
        axes: str | None = None,
        cutoff: float | None = None,
    ) -> Self:
        """A study of columns in memory. The description has the keys of rovid.toml.

        Parameters
        ----------
        data
            A DataFrame, or arrays by name: one row an instant, in order of time.
        signals
            Signal -> column, or ``{"column": …, "unit": "deg" | "rad", "sign": -1}``. ``time`` and, in yaw, ``heading``
            (degrees by default) are needed; ``yaw_rate``, ``roll``, ``pitch``, ``supply_voltage`` and any further
            name are optional. ``torque`` may stand in place of the thrusters. The coupled model also takes
            ``surge_velocity``, ``sway_velocity``, ``north`` and ``east``.
        thrusters
            For each thruster ``name``, ``yaw_arm`` in m (positive turns the heading up), ``command`` (a column) and
            ``curve``: a table with the columns command and thrust_N, or a pair of arrays.
        rudders
            For each rudder the keys of [[rudders]]; ``angle`` is a column, in degrees by default.
        vehicle
            ``name``, ``mass`` in kg, ``length`` and ``width`` in m, or ``rigid_body_inertia`` in kg m^2; and, as
            `rovid fit-thrust-scale` prints them, ``thrust_scale`` and ``thrust_scale_error``.
        run
            Column that names the run of each row; None: all rows are one run.
        axis, axes, cutoff
            As in `rovid.open`.

        Raises
        ------
        RovidError
            A column or a key is missing or wrong, or the data hold no usable measurement.
        """
        document = {
            "vehicle": dict(vehicle or {}),
            "thrusters": [_with_curve(one, place) for place, one in enumerate(thrusters, 1)],
            "rudders": [_with_sources(one) for one in rudders],
            "signals": {name: _source(value) for name, value in signals.items()},
        }
        chosen = _chosen(axis, axes, cutoff)
        config = config_from(document, chosen)
        return cls(axis=chosen, cutoff=cutoff, config=config, trials=tuple(trials_of(data, config, run)))

    @cached_property
    def coupled(self) -> PlanarStudy | None:
        """The runs of surge, sway and yaw together; None for a study of one axis."""
        if self.axis is not PLANAR:
            return None
        if self.config is None:
            return open_planar_study(self.paths)
        return planar_study_of(campaign_of(self.trials, self.config), self.config)

    @cached_property
    def logs(self) -> Study:
        """The runs with their rates, torques and faults; reads the logs."""
        if self.coupled is not None:
            return self.coupled.logs
        if self.config is None:
            return open_study(self.paths, cutoff=self.cutoff, axis=self.axis)
        return study_of(campaign_of(self.trials, self.config), self.config, cutoff=self.cutoff)

    @notebook_progress("Checking the logs …")
    def check(self) -> to.CheckRecord:
        """What is in the logs and what is wrong with them, as `rovid check`."""
        planar, config = self.axis is PLANAR, self.config
        if config is not None:
            found = (check_planar_trials if planar else check_trials)(config, self.trials)
        else:
            config = load_config(find_config(self.paths), self.axis)
            found = (check_planar if planar else check_logs)(self.paths, config)
        return records.check_record(found, config.vehicle)

    @notebook_progress("Fitting …")
    def fit(self, effects: Sequence[str] = (), *, gyro: bool = False) -> to.ModelRecord:
        """All parameters by maximum likelihood, as `rovid fit`.

        Parameters
        ----------
        effects
            Ids of effects to include, as ``thruster_lag`` or ``thruster_lag:rotor``.
        gyro
            Also fit the logged rates, if they come from a gyro of their own.

        Raises
        ------
        RovidError
            The data have a fault that no fit survives, do not determine the parameters, or lack a signal.
        """
        if self.coupled is not None:
            self.logs.require_sound()
            if gyro:
                mend = "Leave it out: all sensors are fitted."
                raise ConfigError("is given together with axes.", where="gyro", mend=mend)
            return records.fit_record(self.coupled.fit(self._effects(effects)), self.coupled)
        require_fittable(self.logs, self.config or load_config(find_config(self.paths), self.axis))
        return records.fit_record(self.logs.likelihood(self._effects(effects), gyro=gyro), self.logs)

    @notebook_progress("Simulating …")
    def simulate(self, model: to.ModelRecord | None = None) -> to.SimulationRecord:
        """Each run simulated freely from its first sample, and compared with the measurement, as `rovid simulate`.

        ``model`` is a fit or a diagnosis, of this study or of another; None: a fit without effects.

        Raises
        ------
        RovidError
            The diagnosis has no model, or the model needs a signal that these logs do not have.
        """
        return records.simulation_record(_stored(model or self.fit()), self.coupled or self.logs)

    def diagnose(
        self, *, budget: float | None = None, force: bool = False, progress: ProgressCallback | None = None
    ) -> to.DiagnosisRecord:
        """What the simulation gets wrong and why, as `rovid diagnose`.

        Parameters
        ----------
        budget
            Time in s; None: a minute for each hour of logs, and at least a minute.
        force
            Diagnose logs with a fault that no fit survives, too.
        progress
            Called with a line at each step, as ``print``; None: a notebook shows the last line below the cell.
        """
        _require_positive(budget=budget)
        with notebook_progress("Reading the logs …") as shown:
            report, logs = progress or shown, self.logs
            if self.coupled is not None:
                found = self.coupled.diagnosis(report, force=force, budget=budget)
                return records.diagnosis_record(found, self.coupled)
            if not force and (reversed_arms := reversed_thrusters(logs)):
                return records.diagnosis_record(Diagnosis(verdict="bad_logs", missing=reversed_arms), logs)
            seconds = logs.default_budget if budget is None else budget
            return records.diagnosis_record(logs.diagnosis(report, force=force, budget=seconds), logs)

    @notebook_progress("Planning the next run …")
    def plan(
        self,
        between: Sequence[str] = (),
        *,
        effects: Sequence[str] = (),
        narrow: str = "",
        share: float = 1.0,
        minutes: float = 10.0,
        max_rate: float = math.inf,
        travel: float = math.inf,
    ) -> to.PlanRecord:
        """The next run, as `rovid plan`: it distinguishes two causes, or narrows the interval of a parameter.

        Parameters
        ----------
        between
            Ids of the two causes to distinguish; empty: narrow a parameter.
        effects
            Further effects of the model.
        narrow
            The parameter; empty: the least certain one.
        share, minutes, max_rate, travel
            Limits: largest command relative to that in the logs, duration, rate in rad/s or m/s, and turns or m.

        Raises
        ------
        RovidError
            No run stays within the limits, or a name is unknown.
        """
        _require_positive(share=share, minutes=minutes, max_rate=max_rate, travel=travel)
        self._require_one_axis("plan")
        self.logs.require_sound()
        causes = self._effects(between)
        if len({cause.id for cause in causes}) not in {0, 2}:
            raise ConfigError(f"names {len(causes)} causes; two different ones were expected.", where="between")
        limits = RunLimits(share=share, seconds=60.0 * minutes, rate=max_rate, travel=travel)
        return records.plan_record(self.logs.plan(self._effects(effects), causes, limits, narrow), self.logs.vehicle)

    def compare(
        self, other: VehicleStudy, *, relevant_change: float = 0.1, progress: ProgressCallback | None = None
    ) -> to.ComparisonRecord:
        """What changed from this study (A) to the ``other`` (B), as `rovid compare`.

        ``relevant_change`` is the relative change of drag or inertia that has to be detectable.
        """
        _require_positive(relevant_change=relevant_change)
        with notebook_progress("Fitting both campaigns …") as shown:
            a, b = self._campaign("a"), other._campaign("b")
            found = compare_campaigns(a, b, relevant_change=relevant_change, report=progress or shown)
            return records.comparison_record(found)

    def _campaign(self, side: str) -> CampaignFit:
        self._require_one_axis("compare")
        return campaign_from_study(self.logs, self.paths[0].resolve().name if self.paths else side)

    @notebook_progress("Simulating …")
    def export(
        self,
        format: str,  # noqa: A002 - as the command's argument
        model: to.ModelRecord | None = None,
    ) -> to.ExportRecord:
        """The model in the format of a simulator, verified by re-simulation, as `rovid export`.

        ``model`` is the fit, or the diagnosis with its extended model; None: a fit without effects.

        Raises
        ------
        RovidError
            There is no such format, the axis is neither yaw nor planar, or the vehicle depends on guesses.
        """
        if self.axis not in {YAW, PLANAR}:
            raise ConfigError(f"is {self.axis.name}; export takes yaw or planar.", where="axis")
        vehicle, coupled = self.logs.vehicle, self.coupled
        if vehicle.assumptions:
            raise ConfigError(vehicle.assumptions.refusal, where=vehicle.name)
        exporter, _ = select_exporter(format, None, planar=coupled is not None)
        if coupled is None:
            vehicle.require_no_rudder("the format")
        stored = _stored(model or self.fit())
        subject = export_input(stored, self.logs) if coupled is None else planar_input(stored, coupled)
        made = verified_export(exporter, subject)
        return records.export_record(format, made, vehicle)

    def _require_one_axis(self, method: str) -> None:
        if self.axis is PLANAR:
            mend = f"Run `rovid {method} --axes planar`."
            raise ConfigError(f"is planar; {method}() works along one axis.", where="axes", mend=mend)

    def _effects(self, names: Sequence[str]) -> tuple[Effect, ...]:
        given, find = [names] if isinstance(names, str) else names, planar_effect if self.coupled else effect_named
        return tuple(map(find, dict.fromkeys(given)))


def open_folder(folder: str | PathLike[str], *, axis: str, axes: str | None, cutoff: float | None) -> VehicleStudy:
    """The study of a folder; see `rovid.open`."""
    study = VehicleStudy(paths=(Path(folder),), axis=_chosen(axis, axes, cutoff), cutoff=cutoff)
    find_config(study.paths)
    return study


def _chosen(axis: str, axes: str | None, cutoff: float | None) -> Axis:
    """The axis of this name, or `PLANAR`."""
    _require_positive(cutoff=cutoff)
    if axes is None:
        return axis_named(axis)
    if axes != PLANAR.name:
        raise ConfigError(f"is {axes!r}; planar was expected.", where="axes", mend="Give axis for a single axis.")
    if axis != YAW.name or cutoff is not None:
        given = "axis" if axis != YAW.name else "cutoff"
        raise ConfigError(f"is given together with {given}.", where="axes", mend=f"Leave {given} out.")
    return PLANAR


def _require_positive(**numbers: float | None) -> None:
    for name, value in numbers.items():
        if value is not None and not value > 0.0:
            raise ConfigError(f"is {value:g}; a positive number was expected.", where=name)


def _stored(model: to.ModelRecord) -> Parameters:
    if model.estimate is None:
        raise DataError("the diagnosis has no model.", mend="Print it: it names what is missing.")
    return model.stored


def _source(value: Any) -> Any:
    """A source as in rovid.toml, whose ``column`` has the key of tables there."""
    if isinstance(value, Mapping):
        return {"csv" if key == "column" else key: one for key, one in value.items()}
    return value


def _with_sources(block: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _source(value) if key in {"command", "azimuth", "angle"} else value for key, value in block.items()}


def _with_curve(thruster: Mapping[str, Any], place: int) -> dict[str, Any]:
    """A thruster as in rovid.toml, with its curve itself."""
    found = _with_sources(thruster)
    if "curve" in found and not isinstance(found["curve"], str):
        found["curve"] = thrust_curve(found["curve"], f"[[thrusters]] number {place} curve")
    return found
