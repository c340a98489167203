"""``rovid plan``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rovid.cli import context
from rovid.cli.options import SharedOptions
from rovid.cli.streams import progress
from rovid.core.errors import ConfigError

if TYPE_CHECKING:
    from rovid.effects import Effect
    from rovid.estimate.candidate_runs import RunLimits
    from rovid.store.parameter_file import Parameters
    from rovid.store.study import Study


def plan(
    logs: list[Path] | None = None,
    *,
    between: list[str] | None = None,
    narrow: str | None = None,
    effect: list[str] | None = None,
    share: float = 1.0,
    minutes: float = 10.0,
    max_rate: float | None = None,
    turns: float | None = None,
    design: bool = False,
    matrix: bool = False,
    output: Path = Path("plan.csv"),
    shared: SharedOptions,
) -> None:
    """Design the next run."""
    from rovid.core.output_files import PLAN, OutputFile, png_signature
    from rovid.effects import effect_named
    from rovid.estimate.experiment_design import command_csv
    from rovid.present.console import show_caution, show_warnings
    from rovid.present.documents.results import plan_document
    from rovid.present.plots.results import plan_picture
    from rovid.present.terminal.results import show_plan

    limits = partial(_limits, share, minutes, max_rate, turns, design)
    if context.is_planar(shared, between=between):
        if matrix or design:
            where = "--matrix" if matrix else "--design"
            raise ConfigError(
                "is for one axis; it does not exist for --axes planar.", where=where, mend="Leave it out."
            )
        _plan_planar(logs, shared, output, effect or (), limits(True), narrow or "")
        return
    causes = tuple(dict.fromkeys(map(effect_named, between or ())))
    if matrix:
        if len(causes) == 1:
            raise ConfigError("names one cause; two or more were expected.", where="--between")
        _plan_matrix(logs, context.parameters_at(shared), causes, effect or (), share, json=shared.json)
        return
    if len({cause.id for cause in causes}) not in {0, 2} or len(causes) > 2:
        raise ConfigError("expects two different causes.", where="--between", mend="Give it once for each of them.")
    stored = context.parameters_at(shared)
    paths = logs or context.stored_logs(stored)
    commands, picture = OutputFile(output, PLAN), OutputFile(output.with_suffix(".png"), png_signature("plan"))
    outputs = context.reserve_outputs([commands, picture], paths, stored.path, force=shared.force)
    study = context.open_logs(paths, None, stored.axis)
    if not shared.force:
        study.require_sound()
    study.vehicle.require_no_rudder("a run of commands")
    effects = tuple(dict.fromkeys((*stored.effect_forms(), *map(effect_named, effect or ()))))
    with progress("Fitting, and comparing candidate runs …"):
        found = study.plan(effects, causes, limits(stored.axis.angular), narrow or "")
    outputs.write({commands: command_csv(found), picture: plan_picture(found, stored.axis)})
    warnings = _stale_effects(stored, study)
    if not (effects or causes or stored.path.exists()):
        reason = "does not exist, so the run is planned for a model without causes"
        warnings = [f"{stored.path} {reason}. Give the parameter file of a diagnosis with -p."]
    if shared.json:
        context.print_json(plan_document(found, study.vehicle, str(commands.path), str(picture.path), warnings))
    else:
        show_caution(context.console(), study.vehicle.assumptions)
        show_plan(context.console(), found, [commands.path, picture.path])
        show_warnings(context.console(), warnings)


def _limits(
    share: float, minutes: float, max_rate: float | None, turns: float | None, design: bool, angular: bool
) -> RunLimits:
    """Limits of a run in SI units."""
    from rovid.estimate.candidate_runs import RunLimits

    rate = math.inf if max_rate is None else max_rate * (math.pi / 180.0 if angular else 1.0)
    travel = math.inf if turns is None else turns
    return RunLimits(share=share, seconds=60.0 * minutes, rate=rate, travel=travel, design=design)


def _plan_matrix(
    logs: Sequence[Path] | None,
    stored: Parameters,
    causes: Sequence[Effect],
    effect: Sequence[str],
    share: float,
    *,
    json: bool,
) -> None:
    """Show which pairs of causes a programme separates: with the model of a fit, or without logs with an estimate."""
    from rovid.effects import effect_named
    from rovid.estimate.candidate_runs import standard_programme
    from rovid.estimate.experiment_design import candidate_model, require_thrusters
    from rovid.estimate.isolability import SizedCause, isolability, split_causes, tested_causes
    from rovid.estimate.vehicle_estimate import estimated_model, full_range_trial
    from rovid.present.console import show_caution, show_warnings
    from rovid.present.documents.results import matrix_document
    from rovid.present.sentences import estimate_warnings
    from rovid.present.terminal.results import show_matrix
    from rovid.readers.campaign import config_without_logs
    from rovid.trial.config import Config

    known, fitted = stored.effect_forms(), list[SizedCause]()
    config = None if stored.path.exists() else config_without_logs(logs or [Path()], stored.axis)
    if config and effect:
        text = "needs logs: without one the size of an effect cannot be fitted."
        raise ConfigError(text, where="--effect", mend="Name causes to compare with --between.")
    study = config or context.open_logs(logs or context.stored_logs(stored), None, stored.axis)
    vehicle = study.vehicle
    require_thrusters(vehicle)
    vehicle.require_no_rudder("a run of commands")
    with progress("Fitting …") as report:
        if isinstance(study, Config):
            base = estimated_model(vehicle, integrated=study.measured_signal == study.axis.rate_signal)
            programme = [full_range_trial(vehicle, study.signals)]
        else:
            forms = tuple(dict.fromkeys((*known, *map(effect_named, effect))))
            base, fitted = split_causes(candidate_model(study.likelihood(forms), "the model"), known)
            assert study.campaign is not None  # noqa: S101 - tables were refused by the fit
            programme = list(study.campaign.trials)
        if config or not logs:
            programme = standard_programme(base.model, vehicle, programme, share)
        tested = tested_causes(base, fitted, causes, vehicle, programme)
        found = isolability(base, tested, vehicle, programme, report)
    warnings = estimate_warnings(base.model) if config else []
    if json:
        context.print_json(matrix_document(found, vehicle, warnings))
    else:
        show_caution(context.console(), vehicle.assumptions)
        show_matrix(context.console(), found)
        show_warnings(context.console(), warnings)


def _stale_effects(stored: Parameters, study: Study) -> list[str]:
    """A warning if the effects come from a parameter file that is out of date."""
    from rovid.store.checks import check_freshness

    reason = stored.effects and check_freshness(stored, study.provenance).reason
    return [f"{stored.path.name} is out of date: {reason}. Only the names of its effects were used."] if reason else []


def _plan_planar(
    logs: Sequence[Path] | None,
    shared: SharedOptions,
    output: Path,
    effect: Sequence[str],
    limits: RunLimits,
    narrow: str,
) -> None:
    """Design the next run of surge, sway and yaw together."""
    from rovid.core.output_files import PLAN, OutputFile
    from rovid.estimate.experiment_design import command_csv
    from rovid.present.documents.planar import planar_plan_document
    from rovid.present.terminal.planar import show_planar_plan
    from rovid.store.planar_study import planar_effect

    stored = context.parameters_at(shared, planar=True)
    effects = list(map(planar_effect, dict.fromkeys((*stored.effects, *effect))))
    paths = logs or context.stored_logs(stored)
    commands = OutputFile(output, PLAN)
    outputs = context.reserve_outputs([commands], paths, stored.path, force=shared.force)
    study = context.open_planar_logs(paths)
    if not shared.force:
        study.logs.require_sound()
    with progress("Fitting, and comparing candidate runs …"):
        found = study.plan(effects, limits, narrow)
    outputs.write({commands: command_csv(found.ranked)})
    warnings = [*study.remarks(), *map(study.vehicle.assumptions.mark_sentence, found.warnings)]
    warnings += _stale_effects(stored, study.logs)
    if shared.json:
        context.print_json(planar_plan_document(found, study.vehicle, str(commands.path), warnings))
    else:
        show_planar_plan(context.console(), found, study, [commands.path], warnings)
