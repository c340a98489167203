"""Tables of the heading controller and of the exports to simulators."""

import contextlib
import math
from collections.abc import Iterator, Mapping

from rovid.control.control_law import ControlLaw
from rovid.control.design import ClosedLoopResult, ControllerDesign
from rovid.core.errors import ConfigError
from rovid.effects import effect_named
from rovid.export import FORMATS
from rovid.export.verification import VerifiedExport
from rovid.present.console import ResultTable, mixed_number_column, number_column, text_column
from rovid.present.number_format import DASH, equal_decimals, format_number, number_with_unit, parameter_title
from rovid.present.sentences import effect_title
from rovid.trial.assumptions import Assumptions


def gains_table(design: ControllerDesign, guess: Assumptions | None = None) -> ResultTable:
    """Gains, delays, torque limits and margins; with bounds over the parameter uncertainty where known."""
    guess = guess or Assumptions()
    columns = [text_column("quantity"), mixed_number_column("value")]
    if design.spread is not None and design.margins.stable:
        columns.append(mixed_number_column(f"95 % of {design.spread.draws} draws"))
    table = ResultTable("The controller and its margins", *columns)
    for quantity, value, unit, bound in _gain_rows(design):
        row = quantity, guess.mark_number(number_with_unit(value, unit), unit), bound
        table.add_row(*row[: len(columns)])
    return table


def _gain_rows(design: ControllerDesign) -> Iterator[tuple[str, str, str, str]]:
    """Quantity, value, unit, and the bound that 95 % of the draws from the parameter covariance keep."""
    law, margins, spread = design.law, design.margins, design.spread
    for name, value in design.autopilot_parameters.items():
        yield name, format_number(value, ".4g"), "", DASH
    yield "gain on heading kp", format_number(law.kp, ".5g"), "N m/rad", DASH
    yield "gain on yaw rate kd", format_number(law.kd, ".5g"), "N m s/rad", DASH
    yield "damping ratio", format_number(design.damping, ".3f"), "", DASH
    yield "bandwidth", format_number(design.bandwidth, ".3g"), "rad/s", DASH
    yield "sampling period", format_number(law.period, "g"), "s", DASH
    if isinstance(law, ControlLaw):
        yield "time constant of the rate filter", format_number(law.rate_filter, ".2g"), "s", DASH
    else:
        yield "torque of full output", format_number(law.full, ".4g"), "N m", DASH
    yield "total delay of the loop", format_number(design.lag, ".2g"), "s", DASH
    for title, torque in zip(("least torque", "largest torque"), torque_limits(design), strict=False):
        yield title, torque, "N m", DASH
    if not margins.stable:
        return
    bounds = (math.nan,) * 4
    if spread is not None:
        bounds = spread.gain_db, spread.phase_deg, spread.delay_s, spread.sensitivity_peak
    yield "gain margin", _bounded(margins.gain_db, ".1f"), "dB", f"≥ {_bounded(bounds[0], '.1f')}"
    yield "phase margin", format_number(margins.phase_deg, ".0f"), "deg", f"≥ {format_number(bounds[1], '.0f')}"
    yield "delay margin", format_number(margins.delay_s, ".2f"), "s", f"≥ {format_number(bounds[2], '.2f')}"
    yield "lag margin", _bounded(margins.lag_s, ".2f"), "s", DASH
    peak = format_number(margins.sensitivity_peak, ".2f")
    yield "peak of the sensitivity", peak, "", f"≤ {format_number(bounds[3], '.2f')}"


def torque_limits(design: ControllerDesign) -> list[str]:
    """The least and the largest torque of the thrusters in N m; empty where they are not known."""
    return equal_decimals((design.allocation.lowest, design.allocation.highest)) if design.allocation.limited else []


def _bounded(value: float, form: str) -> str:
    if math.isinf(value):
        return "without limit"
    return format_number(value, form)


def runs_table(design: ControllerDesign) -> ResultTable:
    """Step metrics of every closed-loop run, in the order of the design."""
    table = ResultTable(
        "Closed-loop runs, with 2 % of the torque in use as disturbance",
        text_column("run"),
        text_column("effects"),
        text_column("model aid"),
        number_column("settled after", "s"),
        number_column("overshoot", "deg"),
        number_column("steady error", "deg"),
        mixed_number_column("limit cycle"),
        number_column("63 % after", "s"),
        number_column("10 to 90 % in", "s"),
        number_column("torque rms", "N m"),
    )
    before = ""
    for run in design.runs:
        effects = "all" if run.effects else "none"
        table.add_row(run.name, effects, *_run_cells(run), begins_section=run.name != before)
        before = run.name
    if design.model.effects:
        return table
    # Without effects in the model the column has no information.
    return table.without("effects")


def _run_cells(run: ClosedLoopResult) -> Iterator[str]:
    metrics, cycle = run.metrics, run.metrics.limit_cycle
    aid = "none"
    if run.model_aid:
        aid = "drag and effects" if run.effects_known else "drag"
    yield aid
    yield format_number(metrics.settling_time, ".1f")
    yield format_number(metrics.overshoot_deg, ".1f")
    yield format_number(metrics.steady_error_deg, ".2f")
    yield "none" if cycle is None else f"±{cycle.amplitude_deg:.2f} deg, {cycle.period_s:.3g} s"
    yield format_number(metrics.time_constant, ".1f")
    yield format_number(metrics.rise_time, ".1f")
    yield format_number(metrics.effort, ".1f")


def formats_table(exports: Mapping[str, VerifiedExport]) -> ResultTable:
    """Difference between each format's equation and the model, and the parts that the format lacks."""
    table = ResultTable(
        "Yaw rate of each format's own equation against the model's",
        text_column("format"),
        text_column("file"),
        number_column("off by", "% of range"),
        mixed_number_column("rms", "rad/s"),
        number_column("of what it holds", "% of range"),
        text_column("not held, % of range"),
    )
    for name, made in exports.items():
        lost = [
            f"{loss_title(loss.what)} {format_number(loss.percent_of_range['yaw_rate'], '.2g')}" for loss in made.losses
        ]
        table.add_row(
            name,
            FORMATS[name].file,
            format_number(made.mismatch.percent_of_range["yaw_rate"], ".2g"),
            format_number(made.mismatch.rms["yaw_rate"], ".2g"),
            format_number(made.kept_mismatch.percent_of_range["yaw_rate"], ".2g"),
            "; ".join(lost) or DASH,
        )
    return table


def loss_title(what: str) -> str:
    """The title of an effect or parameter that a format lacks."""
    with contextlib.suppress(ConfigError):
        return effect_title(effect_named(what))
    return parameter_title(what)


def loss_reasons(exports: Mapping[str, VerifiedExport]) -> list[tuple[str, str, str]]:
    """Formats, the part that they lack, and why; each reason once."""
    formats: dict[tuple[str, str], list[str]] = {}
    for name, made in exports.items():
        for loss in made.losses:
            formats.setdefault((loss_title(loss.what), loss.why), []).append(name)
    return [(", ".join(names), title, why) for (title, why), names in formats.items()]
