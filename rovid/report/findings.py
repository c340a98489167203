"""The diagnosis as the page words it, and its tables."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rovid.campaign.axis import YAW, Axis
from rovid.campaign.vehicle import Vehicle
from rovid.diagnose.amplitudes import Amplitudes, Explanation
from rovid.diagnose.fitted import Rival
from rovid.diagnose.record import INVISIBLE, Diagnosis, Finding, Side, not_identifiable
from rovid.diagnose.signals import is_driver
from rovid.effects import Effect
from rovid.ground.numbers import plus_minus
from rovid.identify.estimate import Estimate
from rovid.identify.inertia import METHODS
from rovid.model.names import unit_of
from rovid.report.grids import Column, Grid, numbers, words
from rovid.report.text import NOTHING, column, number, title, unit

RIVALS = 8  # that are shown


def verdict(diagnosis: Diagnosis) -> str:
    """The whole diagnosis in one plain sentence."""
    if diagnosis.verdict == "found":
        return f"The simulation misses {_listed([_cause(finding) for finding in diagnosis.findings])}."
    if diagnosis.verdict == "suspected":
        first = diagnosis.suspects[0]
        return f"The simulation may miss {_cause(first)}: it is {100.0 * first.confidence:.0f} % sure, not established."
    if diagnosis.verdict == "nothing_found":
        return "Nothing was found: the model explains these data."
    if diagnosis.verdict == "unexplained":
        return "The simulation misses something that no effect of the catalogue explains."
    return "There is too little data for a diagnosis."


def gained(diagnosis: Diagnosis) -> str:
    """What the simulation gains by what was found, in one sentence; empty where nothing was."""
    base, extended = diagnosis.base, diagnosis.extended
    if base is None or extended is None or diagnosis.verdict != "found":
        return ""
    errors = (base.held_out.rate_rmse, extended.held_out.rate_rmse, diagnosis.noise_floor)
    without, with_it, floor = column(errors, 3)
    axis = base.estimate.axis
    return (
        f"With what was found the simulated {axis.rate_words} of trials that were not fitted is off by {with_it} in "
        f"place of {without} {axis.rate_unit}, root mean square; a perfect model's would be by {floor}."
    )


def never_visible(vehicle: Vehicle) -> str:
    """What data of the vehicle's axis cannot show at all."""
    return _listed([INVISIBLE[name] for name in not_identifiable(vehicle)])


def others(finding: Finding) -> str:
    """What ``finding`` cannot be told from; empty where it is decided."""
    return _listed([finding.estimate.axis.words(effect.title) for effect in finding.undecided], "or")


def name_of(effect: Effect, axis: Axis = YAW) -> str:
    """An effect's title, with its form where it has one."""
    name = axis.words(effect.title)
    return f"{name} ({spaced(effect.form)})" if effect.form else name


def spaced(name: str) -> str:
    """A form's name in words; a thruster's stays as it is."""
    return name.replace("_", " ")


def standing(finding: Finding, rival: Rival) -> str:
    """What the data say of a rival."""
    if is_driver(rival.effect):
        return "depends on a signal"
    open_ids = {effect.id for effect in finding.undecided}
    return "not ruled out" if rival.effect.id in open_ids else "ruled out"


def rivals_grid(finding: Finding) -> Grid:
    """What was found beside the best other causes in its place."""
    rivals, axis = finding.rivals[:RIVALS], finding.estimate.axis
    gains = [finding.worth, *(rival.gain for rival in rivals)]
    return Grid(
        caption="What it may be confused with: each cause in its place",
        columns=(
            words("cause", [name_of(effect, axis) for effect in (finding.effect, *(r.effect for r in rivals))]),
            numbers("log-likelihood gained, less the price", "", [number(gain, ".0f") for gain in gains]),
            numbers("behind the first by", "", [NOTHING, *(number(gains[0] - gain, ".0f") for gain in gains[1:])]),
            words("these data", ["found", *(standing(finding, rival) for rival in rivals)]),
        ),
    )


def parameters_grid(finding: Finding) -> Grid:
    """The parameters of what was found."""
    effect, estimate = finding.effect, finding.estimate
    names = [f"{effect.key}.{parameter.name}" for parameter in effect.parameters]
    return Grid(
        caption=f"Parameters of {name_of(effect, estimate.axis)}: value ± standard error",
        columns=(
            words("parameter", [estimate.axis.words(spaced(parameter.name)) for parameter in effect.parameters]),
            Column(title="value", cells=tuple(_value(estimate, name) for name in names)),
            words("unit", [unit(estimate.unit(name)) for name in names]),
        ),
    )


def sides_grid(base: Estimate, extended: Estimate, findings: tuple[Finding, ...]) -> Grid:
    """Parameters without and with what was found."""
    titles = {
        f"{finding.effect.key}.{parameter.name}": base.axis.words(f"{finding.effect.title}: {spaced(parameter.name)}")
        for finding in findings
        for parameter in finding.effect.parameters
    }
    names = list(dict.fromkeys((*base.names, *extended.names)))
    return Grid(
        caption="Parameters without and with what was found: value ± standard error",
        columns=(
            words("parameter", [titles.get(name, title(name)) for name in names]),
            Column(title="without", cells=tuple(_value(base, name) for name in names)),
            Column(title="with what was found", cells=tuple(_value(extended, name) for name in names)),
            numbers("change", "%", [_change(base, extended, name) for name in names]),
            words("unit", [unit(base.unit(name)) for name in names]),
        ),
    )


def gain_grid(base: Side, extended: Side, floor: float) -> Grid:
    """How well trials that were not fitted are simulated; one column where the two sides are the same."""
    one, other, axis = base.held_out, extended.held_out, base.estimate.axis
    names = [f"{axis.rate_words} R²", f"{axis.rate_words} RMSE, {axis.rate_unit}"]
    rows = [[number(one.rate_r2, ".4f"), number(other.rate_r2, ".4f"), NOTHING]]
    rows.append(column([one.rate_rmse, other.rate_rmse, floor], 3))
    for horizon, error in one.position_errors.items():
        names.append(f"{axis.position_words} after {horizon:.0f} s, {axis.shown[0]}")
        errors = [axis.in_shown(each) for each in (error, other.position_errors.get(horizon))]
        rows.append([*column(errors, 3), NOTHING])
    names.append("log-likelihood")
    rows.append([number(one.log_likelihood, ".0f"), number(other.log_likelihood, ".0f"), NOTHING])
    without, with_it, least = zip(*rows, strict=True)
    found = bool(extended.model.effects)
    columns = [words("quantity", names), Column(title="without" if found else "the model", cells=without)]
    if found:
        columns.append(Column(title="with what was found", cells=with_it))
    return Grid(
        caption="Trials that were not fitted, simulated freely",
        columns=(*columns, Column(title="noise floor", cells=least)),
    )


def signals_grid(diagnosis: Diagnosis, axis: Axis) -> Grid:
    """Logged signals that drive what no effect explains."""
    return Grid(
        caption="Signals that what is left depends on",
        columns=(
            words("dependence", [axis.words(signal.title) for signal, _ in diagnosis.signals]),
            numbers("log-likelihood gain", "", [number(gain, ".0f") for _, gain in diagnosis.signals]),
        ),
    )


def detectable_grid(diagnosis: Diagnosis, axis: Axis) -> Grid:
    """The size of each effect that these data would have shown, in the catalogue's order."""
    sizes = diagnosis.detectable
    units = [unit_of(f"{effect.key}.{effect.parameters[0].name}", axis) for effect, _ in sizes]
    return Grid(
        caption="The smallest that would have been seen",
        columns=(
            words("effect", [axis.words(effect.title) for effect, _ in sizes]),
            words("parameter", [axis.words(spaced(effect.parameters[0].name)) for effect, _ in sizes]),
            # Sizes of different units share no decimal point.
            Column(title="departure from none", cells=tuple(_seen(size) for _, size in sizes)),
            words("unit", map(unit, units)),
        ),
    )


def predictions_grid(amplitudes: Amplitudes) -> Grid:
    """The sine trials of a table as measured, and as simulated with the inertia of each method."""
    rows = amplitudes.predictions
    return Grid(
        caption="Peak yaw rate of the sine trials",
        columns=(
            words("trial", [row.trial for row in rows]),
            words("inertia by", [METHODS[row.method] for row in rows]),
            numbers("inertia", unit("kg m^2"), [number(row.inertia, ".0f") for row in rows]),
            numbers("measured", "rad/s", [number(row.measured, ".3g") for row in rows]),
            numbers("simulated", "rad/s", [number(row.predicted, ".3f") for row in rows]),
            numbers("too high by", "%", [f"{100.0 * (row.predicted / row.measured - 1.0):+.0f}" for row in rows]),
        ),
    )


def causes_grid(amplitudes: Amplitudes) -> Grid:
    """What would make one model agree with the tables, and the run that would tell."""
    causes = amplitudes.causes
    return Grid(
        caption="Each of these, alone, would explain the tables",
        columns=(
            words("effect", [name_of(cause.model.effects[0]) for cause in causes]),
            words("with", [", ".join(_sizes(cause)) for cause in causes]),
            numbers("inertia then", unit("kg m^2"), [number(cause.model.inertia, ".0f") for cause in causes]),
            words("run that would tell", [cause.model.effects[0].experiment for cause in causes]),
        ),
    )


def ruled_out(amplitudes: Amplitudes) -> str:
    """What would not."""
    return _listed([effect.title for effect in amplitudes.ruled_out], "or")


def _sizes(cause: Explanation) -> Iterator[str]:
    for name, (value, its_unit) in cause.sizes.items():
        yield f"{spaced(name)} {value:.3g} {unit(its_unit)}".strip()


def _seen(size: float) -> str:
    return column([size], 2)[0] if math.isfinite(size) else "not visible"


def _value(estimate: Estimate, name: str) -> str:
    if name not in estimate.names:
        return NOTHING
    return plus_minus(estimate.value(name), estimate.standard_error(name))


def _change(base: Estimate, extended: Estimate, name: str) -> str:
    """In percent; nothing of what the base model lacks or cannot tell from zero."""
    if name not in base.names or name not in extended.names or abs(base.value(name)) <= base.standard_error(name):
        return NOTHING
    return f"{100.0 * (extended.value(name) / base.value(name) - 1.0):+.1f}"


def _cause(finding: Finding) -> str:
    effects = (finding.effect, *finding.undecided)
    return " or ".join(finding.estimate.axis.words(effect.title) for effect in effects)


def _listed(texts: list[str], last: str = "and") -> str:
    return f" {last} ".join(_joined(texts))


def _joined(texts: list[str]) -> Iterator[str]:
    if len(texts) > 1:
        yield ", ".join(texts[:-1])
    yield from texts[-1:]
