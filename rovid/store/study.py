"""A study of the logs, or tables, in a folder, and what can be identified from them."""

import math
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from rovid.core.budget import SECONDS_PER_HOUR, ProgressCallback
from rovid.core.errors import ConfigError, DataError, LogError, suggestion
from rovid.core.input_files import read_toml
from rovid.diagnose.result import Diagnosis, Finding, ModelAssessment
from rovid.diagnose.tables import TableDiagnosis, diagnose_tables
from rovid.effects import Effect, forms_for, in_angles
from rovid.effects.further_terms import trials_in_form
from rovid.estimate.candidate_runs import RunLimits
from rovid.estimate.dataset import usual_scales
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import (
    ExperimentPlan,
    candidate_model,
    plan_experiment,
    require_thrusters,
    with_visible_size,
)
from rovid.estimate.inertia import InertiaFit, fit_inertia, fit_inertia_table, rigid_body_warnings, with_joint_error
from rovid.estimate.inner_loop import find_inner_loop
from rovid.estimate.maximum_likelihood import LikelihoodFit, fit_likelihood
from rovid.estimate.output_error import Regression
from rovid.estimate.steady_drag import DragFit, fit_drag
from rovid.estimate.steady_points import points_from_table, steady_points
from rovid.faults.base import examine_runs
from rovid.faults.quick_model import log_name
from rovid.faults.thrust_unit import inertia_fault
from rovid.readers import read_campaign
from rovid.readers.campaign import TrialReader, candidate_files
from rovid.store.parameter_file import Parameters, Provenance, Source, absolute_paths, read_source, trial_source
from rovid.trial.assumptions import ConfigFingerprint
from rovid.trial.axis import YAW, Axis
from rovid.trial.config import Config, find_config, load_config, vehicle_without_thrusters
from rovid.trial.fault import Fault, FaultOverrides, fault_texts, stopping
from rovid.trial.preprocessing import PreparedRuns, prepare, shared_channels
from rovid.trial.tables import SINE_COLUMNS, STEADY_COLUMNS, find_table, read_table
from rovid.trial.trial import Campaign, merged_remarks
from rovid.trial.vehicle import Vehicle

_Result = TypeVar("_Result", DragFit, Finding, InertiaFit, LikelihoodFit, ModelAssessment, Regression)


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """A campaign of logs with their runs, or tables of results instead."""

    paths: tuple[Path, ...]  #: Files and folders as given.
    vehicle: Vehicle
    #: ``campaign``, ``runs``: the logs, and the runs prepared from them; None for tables.
    campaign: Campaign | None = None
    runs: PreparedRuns | None = None
    #: ``steady``, ``sine``: tables of steady states and of sine trials; None for logs, or if there is no such table.
    steady: Path | None = None
    sine: Path | None = None
    faults: tuple[Fault, ...] = ()  #: Faults of the logs, with their remedies.
    overrides: FaultOverrides = field(default_factory=FaultOverrides)  #: Faults whose remedy the user rejects.
    #: Fingerprint of the rovid.toml that the logs were read with.
    settings: ConfigFingerprint = field(default_factory=ConfigFingerprint)

    @property
    def provenance(self) -> Provenance:
        """Origin of an estimate from this study; reads every log for its digest."""
        return Provenance(
            logs=absolute_paths(self.paths),
            vehicle=self.vehicle.name,
            sources=self._sources,
            settings=self.settings,
            options="" if self.runs is None or self.runs.chosen else f"--cutoff={self.runs.cutoff:g}",
        )

    @cached_property
    def _sources(self) -> tuple[Source, ...]:
        trials = () if self.campaign is None else self.campaign.trials
        sources, companions = list(map(trial_source, trials)), dict[Path, str]()
        for trial in trials:  # Several trials may come from the same files.
            companions |= {path: f"{path.name} of {trial.parent or trial.name}" for path in trial.companion_files}
        sources += [read_source(name, path, 0) for path, name in companions.items()]
        tables = filter(None, dict.fromkeys((self.steady, self.sine)))
        return (*sources, *(read_source(table.name, table, len(read_table(table).rows)) for table in tables))

    def remarks(self) -> list[str]:
        """Remarks on the logs, including everything that was dropped, without the ``faults``."""
        if self.campaign is None or self.runs is None:
            return []
        remarks = [remark.text for remark in (*self.campaign.remarks, *self.runs.remarks)]
        return [*merged_remarks(self.campaign.trials), *remarks]

    def require_sound(self) -> None:
        """Refuse logs with a fault that no fit survives. Raises LogError if there is such a fault."""
        for fault in stopping(self.faults):
            raise _refused(fault)

    def drag(self) -> DragFit:
        """Drag from steady turns. Raises DataError if there are no steady turns."""
        if self.runs is None:
            if self.steady is None:
                raise DataError(f"there is no table of steady states (columns {', '.join(STEADY_COLUMNS)}).")
            return fit_drag(points_from_table(read_table(self.steady)))
        axis = self.vehicle.axis
        if axis.self_righting:
            text = f"a constant torque does not keep {axis.name} turning. Drag is fitted together with the inertia."
            raise DataError(text, mend="Run `rovid fit-inertia`.")
        fit = self._marked(fit_drag(steady_points(self.runs.items, self.vehicle), axis))
        directions = {name: self._with_assumptions(each) for name, each in fit.directions.items()}
        return replace(fit, directions=directions)

    def inertia(self, drag: Estimate | None) -> InertiaFit:
        """Inertia from sines and other excited data, given the ``drag`` or None. Raises DataError if not determined."""
        rigid_body = self.vehicle.reference_inertia
        if self.runs is None:
            if self.sine is None:
                raise DataError(f"there is no table of sine trials (columns {', '.join(SINE_COLUMNS)}).")
            return fit_inertia_table(read_table(self.sine), drag=drag, rigid_body=rigid_body)
        fit = fit_inertia(self.runs.items, drag=drag, rigid_body=rigid_body)
        with suppress(DataError):  # Without a joint fit the error stays that of the method.
            fit = with_joint_error(fit, fit_likelihood(self.runs.items, self.vehicle).estimate)
        fit = self._marked(fit)
        if fault := self._impossible(fit.estimate):
            raise _refused(fault)
        return replace(fit, regression=fit.regression and self._marked(fit.regression))

    def require_effects(self, effects: Sequence[Effect]) -> None:
        """Raises ConfigError if an effect does not exist for this axis, these trials or these thrusters."""
        trials = [] if self.runs is None else [run.trial.name for run in self.runs.items]
        thruster_forms = [form.key for form in forms_for(self.vehicle, trials=trials or ("",)) if form.per_thruster]
        axis = self.vehicle.axis.name
        for effect in effects:
            for name in set(trials_in_form(effect.form)).difference(trials):
                text = f"there is no trial {name!r} among these. {suggestion(name, trials)}"
                raise ConfigError(text, where=effect.key)
            if effect.axes and axis not in effect.axes:
                raise ConfigError(f"does not exist for {axis}.", where=effect.key)
            if effect.per_thruster and effect.key not in thruster_forms:
                text = f"does not suit the thrusters of this vehicle. {suggestion(effect.key, thruster_forms)}"
                raise ConfigError(text, where=effect.key)

    def require_stored_effects(self, stored: Parameters) -> None:
        """Refuse the file of another vehicle. Raises ConfigError if one of its effects does not suit these logs."""
        effects = stored.effect_forms()
        try:
            self.require_effects(effects)
        except ConfigError as error:
            text = f"holds an effect that does not suit these logs: {error}"
            mend = "If the file is that of another vehicle, give -p with the file of this one, or with a new name."
            raise ConfigError(text, where=stored.path, mend=mend) from error

    def unusual_values(self, stored: Parameters) -> list[str]:
        """A sentence for each value of the model ``stored`` that is far beyond its bounds for these logs."""
        if self.runs is None or not stored.effects:
            return []
        model = stored.model()
        return stored.unusual_values(model.effects, usual_scales(self.runs.items, self.vehicle, model))

    def likelihood(self, effects: tuple[Effect, ...] = (), *, gyro: bool = False) -> LikelihoodFit:
        """Fit of all parameters and of ``effects`` by maximum likelihood; see `fit_likelihood`.

        Raises DataError if there are no logs, or the excitation does not suffice. Raises ConfigError if an effect
        refers to a missing thruster or signal. Raises LogError if the inertia is one that no vehicle has: a unit is
        wrong.
        """
        if self.runs is None:
            raise DataError("a table holds no time series to fit.", where=self.paths[0], mend="Give logs.")
        if self.vehicle.has_rudders_alone:
            effects = tuple(map(in_angles, effects))
        self.require_effects(effects)
        logged = shared_channels(self.runs.items)
        for effect in effects:
            if missing := " and ".join(name for name in effect.needs if name not in logged):
                mend = f"Map {missing} in [signals] of rovid.toml, or leave the effect out."
                raise ConfigError(f"needs {missing}, which not all of these logs hold.", where=effect.key, mend=mend)
        fit = fit_likelihood(self.runs.items, self.vehicle, effects, gyro=gyro)
        if fault := self._impossible(fit.estimate):
            raise _refused(fault)
        warnings = rigid_body_warnings(fit.estimate, self.vehicle.reference_inertia)
        estimate = replace(fit.estimate, warnings=(*fit.estimate.warnings, *warnings))
        return self._marked(replace(fit, estimate=estimate))

    def _impossible(self, estimate: Estimate) -> Fault | None:
        """The fault of an inertia that no vehicle has, unless the user keeps it."""
        if "inertia" in estimate.refused:
            return None
        value, error = estimate.value("inertia"), estimate.standard_error("inertia")
        fault = inertia_fault(value, error, self.vehicle, self.runs.items if self.runs else ())
        return None if fault is None or self.overrides.keep(fault) else fault

    def _with_assumptions(self, estimate: Estimate) -> Estimate:
        """``estimate`` with the vehicle's guesses, and with the error of its thrust scale."""
        return estimate.with_assumptions(self.vehicle.assumptions, self.vehicle.relative_scale_error)

    def _marked(self, result: _Result) -> _Result:
        """``result`` with the vehicle's guesses in its estimate."""
        return replace(result, estimate=self._with_assumptions(result.estimate))

    def plan(
        self, effects: tuple[Effect, ...], between: tuple[Effect, ...], limits: RunLimits, narrow: str = ""
    ) -> ExperimentPlan:
        """The next run: one that distinguishes two causes ``between``, or that narrows the interval of a parameter.

        Raises DataError if there are no logs, or no run stays within the limits. Raises ConfigError if an effect or a
        parameter does not exist.
        """
        if self.campaign is None:
            raise DataError("a table does not hold the vehicle's dynamics.", where=self.paths[0], mend="Give logs.")
        require_thrusters(self.vehicle)
        if between:
            others = tuple(effect for effect in effects if effect.id not in {cause.id for cause in between})
            fitted = [candidate_model(self.likelihood((*others, cause)), cause.key) for cause in between]
            models = list(map(with_visible_size, fitted))
        else:
            models = [candidate_model(self.likelihood(effects), "the model")]
        names = models[0].model.names
        if narrow and narrow not in names:
            raise ConfigError(f"is {narrow!r}. {suggestion(narrow, names)}", where="--narrow")
        return plan_experiment(models, self.vehicle, self.campaign.trials, limits, narrow)

    def amplitudes(self, drag: Estimate | None = None) -> TableDiagnosis:
        """Diagnosis of tables; their own drag precedes ``drag``. Raises DataError without a table of sine trials."""
        if self.sine is None:
            text = "a table of steady turns does not determine the inertia."
            raise DataError(text, where=self.paths[0], mend="Give logs.")
        steady = None
        if self.steady is not None:
            steady, drag = read_table(self.steady), self.drag().estimate
        rigid_body = self.vehicle.rigid_body_inertia
        return diagnose_tables(read_table(self.sine), steady, drag, self.inertia(drag), rigid_body)

    def position_noise(self) -> float | None:
        """Median standard deviation of the position noise; None for tables."""
        return None if self.runs is None else self.runs.noise()[0]

    def median_torque(self) -> float | None:
        """Median magnitude of the nonzero torque in N m; None if there is none."""
        if self.runs is not None:
            torque = np.abs(np.concatenate([run.torque for run in self.runs.items]))
        elif self.steady is not None:
            torque = np.abs([point.torque for point in points_from_table(read_table(self.steady))])
        else:
            return None
        acting = torque[torque > 0.0]
        return float(np.median(acting)) if acting.size else None

    @property
    def default_budget(self) -> float:
        """Time in s that a diagnosis of these logs may take by default: a minute for each hour of logs."""
        logged = sum(run.trial.duration for run in self.runs.items) if self.runs else 0.0
        return SECONDS_PER_HOUR * max(logged / 3600.0, 1.0)

    def diagnosis(
        self,
        report: Callable[[str], None] = lambda _: None,
        *,
        drag: Estimate | None = None,
        force: bool = False,
        budget: float = math.inf,
    ) -> Diagnosis:
        """Errors of the simulation and their causes.

        Raises DataError if there are neither logs nor a table of sine trials.

        ``report``: Called with progress messages.
        ``drag``: Drag of the model if there are only tables of sine trials.
        ``force``: Diagnose logs with a fault that no fit survives, too.
        ``budget``: Time in s after which the diagnosis answers with what it has; what it finds then is likely at most.
        """
        if self.runs is None:
            from_tables = self.amplitudes(drag)
            return Diagnosis(verdict="too_little_data", missing=from_tables.missing, from_tables=from_tables)
        if stopping(self.faults) and not force:
            return Diagnosis(verdict="bad_logs", missing=" ".join(fault_texts(stopping(self.faults))))
        from rovid.diagnose.log_rivals import diagnose_logs

        diagnosis = diagnose_logs(self.runs, self.vehicle, report, budget)
        warnings = [*diagnosis.warnings]
        if final := diagnosis.extended or diagnosis.base:
            if not force and (fault := self._impossible(final.estimate)):
                return Diagnosis(verdict="bad_logs", missing=fault.text, faults=(fault,))
            warnings += rigid_body_warnings(final.estimate, self.vehicle.reference_inertia)
        return replace(
            diagnosis,
            base=diagnosis.base and self._marked(diagnosis.base),
            extended=diagnosis.extended and self._marked(diagnosis.extended),
            findings=tuple(map(self._marked, diagnosis.findings)),
            suspects=tuple(map(self._marked, diagnosis.suspects)),
            warnings=tuple(map(self.vehicle.assumptions.mark_sentence, warnings)),
        )


def _refused(fault: Fault) -> LogError:
    mend = f'Correct it, or set {fault.fault} = "keep" in [faults] of rovid.toml.'
    return LogError(fault.text, where="", mend=mend)


def input_files(paths: Sequence[Path]) -> list[Path]:
    """Files that rovid may read for ``paths``: logs, tables, rovid.toml and its thrust curves, without planned runs."""
    files = [path for path in candidate_files(paths) if path.is_file()]
    return [*files, *config_files(paths)] if paths else []


def config_files(paths: Sequence[Path]) -> list[Path]:
    """The rovid.toml of ``paths``, its thrust curves and the file of its prior, as far as they exist."""
    files: list[Path] = []  # Errors in rovid.toml are reported when the file is loaded.
    with suppress(ConfigError):
        config = find_config(paths)
        files.append(config)
        document = read_toml(config)
        blocks, coupled = document.get("thrusters"), document.get("planar")
        tables = [*blocks] if isinstance(blocks, list) else []
        tables += [coupled.get("prior")] if isinstance(coupled, dict) else []
        known = [table for table in tables if isinstance(table, dict)]
        named = [config.parent / str(table[key]) for table in known for key in ("curve", "file") if key in table]
        files += [path for path in named if path.exists()]
    return files


def open_study(
    paths: Sequence[Path],
    *,
    cutoff: float | None = None,
    axis: Axis = YAW,
    reading: TrialReader | None = None,
    without: Collection[Path] = (),
    report: ProgressCallback = lambda _: None,
) -> Study:
    """Read the logs, or tables, in ``paths``.

    Raises RovidError if the logs or rovid.toml cannot be read, or a controller of the rate answers the only command.

    ``cutoff``: Cut-off frequency of the low-pass filter for rates in Hz; None: chosen from the data.
    ``reading``, ``without``: Reader of single logs, and files to leave out, as in `read_campaign`.
    """
    steady, sine = find_table(paths, STEADY_COLUMNS), find_table(paths, SINE_COLUMNS)
    if steady is not None or sine is not None:
        if axis is not YAW:
            text = f"{(steady or sine)} is a table of yaw; tables of other axes are not supported."
            raise ConfigError(text, where="--axis", mend="Give logs, or leave --axis out.")
        return Study(paths=tuple(paths), vehicle=vehicle_without_thrusters(paths), steady=steady, sine=sine)
    config = load_config(find_config(paths), axis)
    return study_of(read_campaign(paths, config, report, reading=reading, without=without), config, cutoff=cutoff)


def study_of(campaign: Campaign, config: Config, *, cutoff: float | None = None, planar: bool = False) -> Study:
    """The study of a ``campaign`` that was read with ``config``; see `open_study`, and `open_planar_study`."""
    vehicle = config.vehicle.with_logged_torque(campaign.trials)
    if stopping(campaign.faults):
        vehicle = vehicle.clamped()  # Commands of another unit than the curve are outside it.
    runs = prepare(campaign, vehicle, cutoff=cutoff)
    if not planar and (loop := find_inner_loop(runs.items, config)) is not None:
        raise loop.error
    items, faults = examine_runs(runs.items, vehicle, config.faults)
    doubtful = {log for fault in faults if fault.may_be_explained for log in fault.logs}
    aside = tuple(run for run in runs.items if log_name(run) in doubtful)
    clocks_agree = "*" in config.faults.kept.get("clocks_apart", ())
    return Study(
        paths=campaign.sources,
        vehicle=vehicle,
        campaign=campaign,
        runs=replace(runs, items=items, set_aside=aside, clocks_agree=clocks_agree),
        faults=(*campaign.faults, *faults),
        overrides=config.faults,
        settings=config.fingerprint,
    )
