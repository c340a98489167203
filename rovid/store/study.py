"""What the user's LOGS hold, logs or tables, and what can be identified from them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from rovid.core.errors import ConfigError, DataError, suggestion
from rovid.core.signatures import PLAN
from rovid.core.toml import read_toml
from rovid.design.candidate_runs import RunLimits
from rovid.design.experiment_design import (
    CandidateModel,
    ExperimentPlan,
    candidate_model,
    plan_experiment,
    require_thrusters,
)
from rovid.diagnose.result import Diagnosis, Finding, ModelAssessment
from rovid.diagnose.tables import TableDiagnosis, diagnose_tables
from rovid.effects import Effect, forms_for
from rovid.effects.per_trial import trials_in_form
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import InertiaFit, fit_inertia, fit_inertia_table, rigid_body_warnings
from rovid.estimate.maximum_likelihood import LikelihoodFit, fit_likelihood
from rovid.estimate.steady_drag import DragFit, fit_drag
from rovid.estimate.steady_points import points_from_table, steady_points
from rovid.readers import read_campaign
from rovid.readers.campaign import TrialReader
from rovid.readers.discover import candidate_files
from rovid.signals.preprocessing import PreparedRuns, prepare, shared_channels
from rovid.store.parameter_file import Provenance, Source, absolute_paths, read_source
from rovid.trial.axis import YAW, Axis
from rovid.trial.config import find_config, load_config, vehicle_without_thrusters
from rovid.trial.config_fingerprint import ConfigFingerprint
from rovid.trial.tables import SINE_COLUMNS, STEADY_COLUMNS, find_table, read_table
from rovid.trial.trial import Campaign, merged_remarks
from rovid.trial.vehicle import Vehicle

# Effects that a clock which is behind looks like.
_LATE = ("command_delay", "thruster_lag")


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Logs with their runs, or tables of results in their place.

    Attributes
    ----------
    paths
        As the user gave them.
    campaign, runs
        None where there are tables.
    steady, sine
        Tables of steady states and of sine trials; None where there are logs, or no such table.
    settings
        What of rovid.toml the logs were read by.
    """

    paths: tuple[Path, ...]
    vehicle: Vehicle
    campaign: Campaign | None = None
    runs: PreparedRuns | None = None
    steady: Path | None = None
    sine: Path | None = None
    settings: ConfigFingerprint = field(default_factory=ConfigFingerprint)

    @property
    def provenance(self) -> Provenance:
        """What an estimate of this study comes of; every log is read for its digest."""
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
        logs = [read_source(trial.name, trial.path, int(trial.measured.sum())) for trial in trials]
        # Parts of one log were read from the same files.
        beside = {
            path: f"{path.name} of {trial.parent or trial.name}" for trial in trials for path in trial.companion_files
        }
        logs += [read_source(name, path, 0) for path, name in beside.items()]
        tables = [table for table in (self.steady, self.sine) if table is not None]
        return (
            *logs,
            *(read_source(table.name, table, len(read_table(table).rows)) for table in dict.fromkeys(tables)),
        )

    def remarks(self) -> list[str]:
        """What was noticed in the logs, so that nothing is dropped silently."""
        if self.campaign is None or self.runs is None:
            return []
        logs = merged_remarks(self.campaign.trials)
        return [*logs, *(remark.text for remark in (*self.campaign.remarks, *self.runs.remarks))]

    def drag(self) -> DragFit:
        """Drag from steady turns.

        Raises
        ------
        DataError
            There are none.
        """
        if self.runs is not None:
            if self.vehicle.axis.self_righting:
                raise DataError(
                    f"no constant torque keeps {self.vehicle.axis.name} turning: drag is found with the inertia.",
                    mend="Run `rovid fit-inertia`.",
                )
            fit = fit_drag(steady_points(self.runs.items, self.vehicle), self.vehicle.axis)
            directions = {name: self._guessing(each) for name, each in fit.directions.items()}
            return replace(fit, estimate=self._guessing(fit.estimate), directions=directions)
        if self.steady is None:
            raise DataError(f"there is no table of steady states (columns {', '.join(STEADY_COLUMNS)}).")
        return fit_drag(points_from_table(read_table(self.steady)))

    def inertia(self, drag: Estimate | None) -> InertiaFit:
        """Inertia from sine runs and all excited data, with the steady ``drag`` where it is known.

        Raises
        ------
        DataError
            There is nothing to read it from.
        """
        rigid_body = self.vehicle.reference_inertia
        if self.runs is not None:
            fit = fit_inertia(self.runs.items, drag=drag, rigid_body=rigid_body)
            regression = fit.regression and replace(fit.regression, estimate=self._guessing(fit.regression.estimate))
            return replace(fit, estimate=self._guessing(fit.estimate), regression=regression)
        if self.sine is None:
            raise DataError(f"there is no table of sine trials (columns {', '.join(SINE_COLUMNS)}).")
        return fit_inertia_table(read_table(self.sine), drag=drag, rigid_body=rigid_body)

    def require_effects(self, effects: Sequence[Effect]) -> None:
        """Refuse effects that this axis, or these trials, do not know, or on a thruster lacking or with none beside it.

        Raises
        ------
        ConfigError
            There is such an effect; those of this vehicle are offered.
        """
        known = [form.key for form in forms_for(self.vehicle) if form.per_thruster]
        trials = [run.trial.name for run in (self.runs.items if self.runs else ())]
        for effect in effects:
            for name in set(trials_in_form(effect.form)).difference(trials):
                raise ConfigError(
                    f"there is no trial {name!r} among these. {suggestion(name, trials)}", where=effect.key
                )
            if effect.axes and self.vehicle.axis.name not in effect.axes:
                raise ConfigError(f"is nothing that acts in {self.vehicle.axis.name}.", where=effect.key)
            if effect.per_thruster and effect.key not in known:
                raise ConfigError(
                    f"does not suit the thrusters of this vehicle. {suggestion(effect.key, known)}", where=effect.key
                )

    def likelihood(self, effects: tuple[Effect, ...] = (), *, gyro: bool = False) -> LikelihoodFit:
        """All parameters at once by maximum likelihood, those of ``effects`` included; see `fit_likelihood`.

        Raises
        ------
        DataError
            There are no logs, or the vehicle was not excited enough.
        ConfigError
            An effect acts on a thruster or through a signal that is not there.
        """
        if self.runs is None:
            raise DataError("a table holds no time series to fit.", where=self.paths[0], mend="Give logs.")
        self.require_effects(effects)
        logged = shared_channels(self.runs.items)
        for effect in effects:
            _require_channels(effect, logged)
        fit = fit_likelihood(self.runs.items, self.vehicle, effects, gyro=gyro)
        odd = rigid_body_warnings(fit.estimate, self.vehicle.reference_inertia)
        estimate = replace(fit.estimate, warnings=(*fit.estimate.warnings, *odd))
        return replace(fit, estimate=self._guessing(estimate))

    def _guessing(self, estimate: Estimate) -> Estimate:
        """``estimate``, which knows what of the vehicle is a guess, and says so in what it warns of."""
        guess = self.vehicle.assumptions
        return replace(estimate, assumptions=guess, warnings=tuple(map(guess.mark_sentence, estimate.warnings)))

    def plan(
        self,
        effects: tuple[Effect, ...],
        between: tuple[Effect, ...],
        limits: RunLimits,
        narrow: str = "",
    ) -> ExperimentPlan:
        """The run to make next: to tell two causes apart, each beside ``effects``, or to make a parameter surer.

        Raises
        ------
        DataError
            There are no logs, or no run stays within the limits.
        ConfigError
            An effect or a parameter is not there.
        """
        if self.campaign is None:
            raise DataError(
                "a table does not say how fast the vehicle answers.", where=self.paths[0], mend="Give logs."
            )
        require_thrusters(self.vehicle)
        fits = self._beliefs(effects, between)
        if narrow and narrow not in fits[0].model.names:
            raise ConfigError(f"is {narrow!r}. {suggestion(narrow, fits[0].model.names)}", where="--narrow")
        return plan_experiment(fits, self.vehicle, self.campaign.trials, limits, narrow)

    def _beliefs(self, effects: tuple[Effect, ...], between: tuple[Effect, ...]) -> list[CandidateModel]:
        """What the logs say of each rival beside ``effects``, or of those alone where there is none."""
        others = tuple(effect for effect in effects if effect.id not in {rival.id for rival in between})
        models = [(*others, rival) for rival in between] or [others]
        names = [rival.key for rival in between] or ["the model"]
        return [candidate_model(self.likelihood(model), name) for model, name in zip(models, names, strict=True)]

    def amplitudes(self, drag: Estimate | None = None) -> TableDiagnosis:
        """What would make one model agree with all rows of the tables; the steady turns' own drag goes before ``drag``.

        Raises
        ------
        DataError
            There is no table of sine trials.
        """
        if self.sine is None:
            raise DataError("a table of steady turns fits any inertia.", where=self.paths[0], mend="Give logs.")
        steady = None if self.steady is None else read_table(self.steady)
        drag = drag if steady is None else self.drag().estimate
        rigid_body = self.vehicle.rigid_body_inertia
        return diagnose_tables(read_table(self.sine), steady, drag, self.inertia(drag), rigid_body)

    def position_noise(self) -> float | None:
        """Median standard deviation of the noise of what is measured; None for tables."""
        return None if self.runs is None else self.runs.noise()[0]

    def median_torque(self) -> float | None:
        """Median size in N m of the torque while there was any; None where the study has none."""
        if self.runs is not None:
            torque = np.abs(np.concatenate([run.torque for run in self.runs.items]))
        elif self.steady is not None:
            torque = np.abs([point.torque for point in points_from_table(read_table(self.steady))])
        else:
            return None
        acting = torque[torque > 0.0]
        return float(np.median(acting)) if acting.size else None

    def diagnosis(self, report: Callable[[str], None] = lambda _: None, *, drag: Estimate | None = None) -> Diagnosis:
        """What the simulation gets wrong and why; ``report`` is told how far it is.

        Where there are tables of sines alone, ``drag`` is that of the model.

        Raises
        ------
        DataError
            There are neither logs nor a table of sine trials.
        """
        if self.runs is None:
            amplitudes = self.amplitudes(drag)
            return Diagnosis(verdict="too_little_data", missing=amplitudes.missing, from_tables=amplitudes)
        from rovid.diagnose.algorithm import diagnose

        diagnosis = diagnose(self.runs, self.vehicle, report)
        side = diagnosis.extended or diagnosis.base
        odd = rigid_body_warnings(side.estimate, self.vehicle.reference_inertia) if side else ()
        return replace(
            diagnosis,
            base=self._guessing_side(diagnosis.base),
            extended=self._guessing_side(diagnosis.extended),
            findings=tuple(map(self._guessing_finding, diagnosis.findings)),
            suspects=tuple(map(self._guessing_finding, diagnosis.suspects)),
            warnings=(*diagnosis.warnings, *odd, *self._of_clocks((*diagnosis.findings, *diagnosis.suspects))),
        )

    def _of_clocks(self, findings: Sequence[Finding]) -> Iterator[str]:
        """What else makes a command late, where commands and motion were logged by two clocks that nobody compared."""
        named = {effect.id: effect.title for one in findings for effect in (one.effect, *one.indistinguishable)}
        late = [title for key, title in named.items() if key in _LATE]
        taken = any(
            remark.kind == "joined" for run in (self.runs.items if self.runs else ()) for remark in run.trial.remarks
        )
        if late and taken:
            yield (
                f"The {' or '.join(late)} may be the clocks of the joined files: one that is behind does the same, and "
                "no log tells which. Give what is known of them in [join] offset."
            )

    def _guessing_side(self, side: ModelAssessment | None) -> ModelAssessment | None:
        return None if side is None else replace(side, estimate=self._guessing(side.estimate))

    def _guessing_finding(self, finding: Finding) -> Finding:
        return replace(finding, estimate=self._guessing(finding.estimate))


def input_files(paths: Sequence[Path]) -> list[Path]:
    """What may be read where ``paths`` are: logs, tables, rovid.toml and its thrust curves; not what rovid planned."""
    if not paths:
        return []
    files = [path for path in candidate_files(paths) if path.is_file() and not PLAN.matches(path)]
    return [*files, *config_files(paths)]


def config_files(paths: Sequence[Path]) -> list[Path]:
    """The rovid.toml of ``paths`` and its thrust curves, as far as they are there."""
    files: list[Path] = []
    # Whatever is wrong with rovid.toml is said by those who need it.
    with contextlib.suppress(ConfigError):
        config = find_config(paths)
        files.append(config)
        blocks = read_toml(config).get("thrusters")
        tables = [block for block in (blocks if isinstance(blocks, list) else ()) if isinstance(block, dict)]
        curves = [config.parent / str(table["curve"]) for table in tables if "curve" in table]
        files += [curve for curve in curves if curve.exists()]
    return files


def _require_channels(effect: Effect, logged: Collection[str]) -> None:
    missing = " and ".join(name for name in effect.needs if name not in logged)
    if missing:
        text = f"needs {missing}, which these logs do not all hold."
        mend = f"Map {missing} in [signals] of rovid.toml, or leave the effect out."
        raise ConfigError(text, where=effect.key, mend=mend)


def open_study(
    paths: Sequence[Path],
    *,
    cutoff: float | None = None,
    axis: Axis = YAW,
    reading: TrialReader | None = None,
    without: Collection[Path] = (),
) -> Study:
    """Read whatever ``paths`` hold; ``reading`` and ``without`` as in `read_campaign`.

    Raises
    ------
    RovidError
        The logs or rovid.toml cannot be read.
    """
    steady, sine = find_table(paths, STEADY_COLUMNS), find_table(paths, SINE_COLUMNS)
    if steady is not None or sine is not None:
        if axis is not YAW:
            text = f"{(steady or sine)} is a table of yaw, and no table is read along another axis."
            raise ConfigError(text, where="--axis", mend="Give logs, or leave --axis out.")
        return Study(paths=tuple(paths), vehicle=vehicle_without_thrusters(paths), steady=steady, sine=sine)
    config = load_config(find_config(paths), axis)
    campaign = read_campaign(paths, config, reading=reading, without=without)
    vehicle = config.vehicle.with_logged_torque(campaign.trials)
    runs = prepare(campaign, vehicle, cutoff=cutoff)
    return Study(paths=tuple(paths), vehicle=vehicle, campaign=campaign, runs=runs, settings=config.fingerprint)
