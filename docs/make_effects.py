"""Write the pages and pictures of docs/effects from the catalogue of effects and docs/effects/notes.toml.

Run from the checkout as ``python docs/make_effects.py``. Arguments are the ids of the effects to draw (default: all).
The command writes all pages in any case, because the pages refer to each other. A test compares the text of the pages.
"""

from __future__ import annotations

import argparse
import math
import textwrap
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, RovidError, suggestion
from rovid.diagnose.result import DISCRIMINATING_RUNS
from rovid.effects import ANGLE_FORMS, CATALOGUE, FORMS, PLANAR_FORMS, Effect, EffectParameter
from rovid.effects.base import (
    SPEEDS,
    Coupling,
    OnCommand,
    OnHeading,
    OnThrust,
    OnTorque,
    SensorPlace,
    Term,
    WaterCurrent,
    WaveTorque,
)
from rovid.effects.thruster_imbalance import WITH_OTHERS, for_thruster
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput
from rovid.present.plots.canvas import BLACK, BLUE, ORANGE, PALE, panel_grid, render_png, report_style
from rovid.trial.axis import AXES, YAW, Axis
from rovid.trial.config import load_config
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

FOLDER = Path(__file__).parent / "effects"
NOTES = FOLDER / "notes.toml"
PLANAR_NOTES = FOLDER / "planar_notes.toml"
INDEX = "README.md"
_CONFIG = Path(__file__).parent.parent / "sample_logs" / "rosub_tank" / "rovid.toml"
_INERTIA, _QUADRATIC, _LINEAR = 5057.0, 3532.0, 132.0
_STEP = 0.05  # s
_REST = 4.0  # s
# V; thrust of the sample vehicle goes as the square of what is beyond its dead zone, in reverse with another factor.
_DEAD_ZONE, _REVERSE_SHARE = 0.3, math.sqrt(9.4 / 5.3)
_SINE = 2.0  # V
_PERIODS = 2.5
_THRUSTER = "fore"
_JUMP = 0.5  # V
_SIZES = ("amplitude", "back_", "quadratic", "munk")
_COLUMNS = 116
_BASE = "I·ṙ + DQ·|r|·r + DL·r = T(u)"
_RESIDUAL = "T − I·ṙ − DQ·|r|·r − DL·r"
_MADE = "<!-- Made by docs/make_effects.py from the catalogue and notes.toml. Edit those and run it again. -->"

_PLACES = {
    OnCommand: "acts on each command, before the thrust curve",
    OnThrust: "acts on each thruster's thrust, after the bench curve",
    OnTorque: "acts on the total torque of the thrusters",
    Term: "a torque in the equation of motion",
    OnHeading: "acts on the measured heading; the motion is unchanged",
    WaveTorque: "a torque in the equation of motion, of random phase",
    Coupling: "forces in the equations of surge, sway and yaw; `--axes planar` only",
    SensorPlace: "acts on the readings of a velocity log or an antenna; `--axes planar` only",
    WaterCurrent: "speed of the water in the equations of surge, sway and yaw; `--axes planar` only",
}
_OF_ANGLES = "acts on the angles of rudders, and with `--axes planar` on those of azimuth thrusters"
_AXES = {
    "time": "time in the step, s",
    "command": "command, V",
    "torque": "torque by the bench curve, N m",
    "rate": "yaw rate, rad/s",
    "turns": "turns since the start",
    "heading": "heading, deg",
    "tilt": "tilt, deg",
    "swept": "angle since the reversal, deg",
}


@dataclass(frozen=True, kw_only=True)
class Note:
    """Hand-written notes on an effect; see notes.toml."""

    text: str
    sizes: tuple[str, ...]
    values: Mapping[str, float]
    hold: float
    period: float
    against: str
    left_out: str = ""
    alone: bool = False
    volts: float = 1.8
    speeds: tuple[float, float] = (0.0, 0.0)
    stiffness: float = 0.0


_KEYS = tuple(key.name for key in fields(Note))
# Required keys.
_WANTED = tuple(key.name for key in fields(Note) if key.default is MISSING)


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """One simulated run with the effect and without it, arrays (n,).

    ``left`` is the residual torque in N m, mean over each interval. ``torque`` is the torque of the bench curve.
    """

    time: FloatArray
    command: FloatArray
    torque: FloatArray
    rate: FloatArray
    heading: FloatArray
    plain: FloatArray
    left: FloatArray = field(repr=False)


def notes() -> dict[str, Note]:
    """Hand-written notes by effect id.

    Raises
    ------
    ConfigError
        An effect has no entry or an incomplete one, or an entry has an unknown id.
    """
    with NOTES.open("rb") as file:
        document = tomllib.load(file)
    ids = [effect.id for effect in CATALOGUE]
    for name in ids:
        if name not in document:
            raise _refused(f"has no entry [{name}] with the keys {_listed(_WANTED)}.")
    for name in document:
        if name not in ids:
            raise _refused(f"[{name}] is not the id of an effect. {suggestion(name, ids)}")
    return {name: _note(name, entry) for name, entry in document.items()}


def _note(name: str, entry: dict[str, Any]) -> Note:
    missing = [key for key in _WANTED if key not in entry]
    if missing:
        raise _refused(f"[{name}] has no {_listed(missing)}.")
    unknown = [key for key in entry if key not in _KEYS]
    if unknown:
        raise _refused(f"[{name}] has {unknown[0]}. {suggestion(unknown[0], _KEYS)}")
    wanted = [parameter.name for parameter in _plain(name).parameters]
    if list(entry["values"]) != wanted:
        raise _refused(f"[{name}]: values has {_listed(entry['values'])}; the parameters are {_listed(wanted)}.")
    if entry["against"] not in _AXES:
        raise _refused(f"[{name}]: against is {entry['against']!r}. {suggestion(entry['against'], _AXES)}")
    plain = entry | {"text": " ".join(entry["text"].split()), "sizes": tuple(entry["sizes"])}
    if "speeds" in entry:
        plain["speeds"] = tuple(entry["speeds"])
    return Note(**plain)


def _refused(text: str) -> ConfigError:
    return ConfigError(text, where=NOTES.name, mend="The head of the file explains the keys.")


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)


def _plain(name: str) -> Effect:
    return next(effect for effect in (*CATALOGUE, *PLANAR_FORMS) if effect.id == name and not effect.form)


def forms_of(effect: Effect) -> list[Effect]:
    """Forms of an effect, the default form first."""
    if effect.per_thruster:
        return [for_thruster("NAME"), for_thruster("NAME" + WITH_OTHERS)]
    return [form for form in (*FORMS, *PLANAR_FORMS, *ANGLE_FORMS) if form.id == effect.id]


# ---- the runs of the pictures


def runs_with(effect: Effect, note: Note) -> tuple[Course, Course]:
    """Step and sine with ``effect`` at the size of its plot."""
    vehicle = load_config(_CONFIG).vehicle
    acting = for_thruster(_THRUSTER) if effect.per_thruster else effect
    step, sine = _step_commands(note), _sine_commands(note.period)
    return _course(vehicle, acting, note, step), _course(vehicle, acting, note, sine)


def reverse(volts: float) -> float:
    """Reverse command in V with the same torque as ``volts`` forward."""
    return -(_DEAD_ZONE + (volts - _DEAD_ZONE) * _REVERSE_SHARE)


def _axis(effect: Effect) -> Axis:
    """Axis of the plot."""
    return YAW if not effect.axes or YAW.name in effect.axes else AXES[effect.axes[0]]


def _step_commands(note: Note) -> FloatArray:
    count = round(note.hold / _STEP)
    ahead, astern = note.volts, reverse(note.volts)
    ways = [(ahead, 0.0), (0.0, ahead)] if note.alone else [(ahead, ahead), (astern, astern)]
    legs = [(round(_REST / _STEP), (0.0, 0.0)), *((count, way) for way in ways), (count, (0.0, 0.0))]
    return np.concatenate([np.tile(way, (length, 1)) for length, way in legs])


def _sine_commands(period: float) -> FloatArray:
    wave = np.sin(2.0 * np.pi / period * np.arange(0.0, _PERIODS * period, _STEP))
    volts = np.where(wave > 0.0, _SINE, -reverse(_SINE)) * wave
    # Every sample of the sine is a command. The rest before the sine shows effects that act without a command.
    return np.tile(np.concatenate((np.zeros(round(_REST / _STEP)), volts))[:, None], (1, 2))


def _course(vehicle: Vehicle, effect: Effect, note: Note, commands: FloatArray) -> Course:
    time: FloatArray = np.arange(len(commands), dtype=np.float64) * _STEP
    trial = Trial(
        name="run",
        path=Path("run"),
        time=time,
        position=np.zeros(len(time)),
        commands=commands,
        reference=dict(zip(SPEEDS, note.speeds, strict=True)),
    )
    base = Model(
        inertia=_INERTIA,
        quadratic_drag=_QUADRATIC,
        linear_drag=_LINEAR,
        axis=_axis(effect),
        restoring_values=(note.stiffness, 0.0) if note.stiffness else (),
    )
    drive = base.torque_input(vehicle, trial)
    torque = drive.torque
    if effect.is_wave:
        model, push = (
            base,
            TorqueInput.held(torque + note.values["amplitude"] * np.sin(note.values["frequency"] * time)),
        )
    else:
        model = replace(base, effects=(effect,), effect_values=tuple(note.values.values()))
        push = model.torque_input(vehicle, trial)
    rate, heading = model.simulate(trial, push)
    drag = base.drag(rate) + note.stiffness * np.sin(heading)
    left = torque[:-1] - _INERTIA * np.diff(rate) / _STEP - 0.5 * (drag[1:] + drag[:-1])
    return Course(
        time=time - _REST,
        command=commands.max(axis=1) + commands.min(axis=1) if note.alone else commands[:, 0],
        torque=torque,
        rate=rate,
        heading=heading,
        plain=base.simulate(trial, drive)[0],
        left=np.append(left, left[-1]),
    )


# ---- the pictures


@report_style
def picture(effect: Effect, note: Note) -> Figure:
    """Plot of a step, a sine and the residual torque with ``effect``."""
    step, sine = runs_with(effect, note)
    figure, ((first, second, third),) = panel_grid(
        [(1.95, 3)], left=0.72, right=0.15, top=0.6, bottom=0.52, across=0.82
    )
    for panel, course, name in ((first, step, "step"), (second, sine, f"sine of {note.period:g} s")):
        panel.plot(course.time, course.rate, color=PALE, linewidth=3.6, label="with the effect")
        panel.plot(course.time, course.plain, color=BLACK, linewidth=1.1, label="base model")
        panel.set(
            xlabel="time, s",
            ylabel=f"{_axis(effect).rate_words}, rad/s",
            title=name,
            xlim=(course.time[0], course.time[-1]),
        )
    # Steps have few commands: dots. Otherwise a broad line under a thin line, because both may coincide.
    dots = note.against in {"command", "torque"}
    both = note.against != "time" and not isinstance(effect.acts, OnHeading)
    look: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 5.0, "markeredgewidth": 0.0}
    look = look if dots else {"linewidth": 2.6 if both else 1.3}
    third.plot(*_residual(step, note.against), color=BLUE, label="residual, step", zorder=3 if dots else 2, **look)
    if both:
        third.plot(*_residual(sine, note.against), color=ORANGE, linewidth=1.1, label="residual, sine")
    third.axhline(0.0, color=BLACK, linewidth=0.8)
    third.set(xlabel=_AXES[note.against], ylabel="residual torque, N m", title="residual torque")
    if note.against == "time":
        third.set_xlim(step.time[0], step.time[-1])
    low, high = third.get_ylim()
    # Keep a constant residual flat.
    reach = 0.15 * max(abs(low), abs(high))
    third.set_ylim(min(low, -reach), max(high, reach))
    handles, labels = first.get_legend_handles_labels()
    more, further = third.get_legend_handles_labels()
    figure.legend(
        handles + more, labels + further, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=4, borderaxespad=0.2
    )
    return figure


def _residual(course: Course, against: str) -> tuple[FloatArray, FloatArray]:
    """Horizontal and vertical values; NaN between samples that a line should not join."""
    if against == "time":
        return course.time, course.left
    drivers = {
        "command": course.command,
        "torque": course.torque,
        "rate": course.rate,
        "turns": course.heading / (2.0 * np.pi),
        "tilt": np.degrees(course.heading),
        "heading": np.degrees(course.heading) % 360.0,
        "swept": np.degrees(_swept(course.rate)),
    }
    driver = drivers[against]
    jumps = np.abs(np.diff(course.command, prepend=course.command[0])) > _JUMP
    back = {"heading": np.abs(np.diff(driver, prepend=driver[0])) > 180.0, "swept": np.diff(driver, prepend=0.0) < 0.0}
    return driver, np.where(jumps | back.get(against, np.zeros_like(jumps)), np.nan, course.left)


def _swept(rate: FloatArray) -> FloatArray:
    """Angle in rad since the last change of sign of the rate."""
    total = np.cumsum(np.abs(rate)) * _STEP
    reversed_at = np.flatnonzero(np.diff(np.sign(rate)) != 0.0) + 1
    last = np.searchsorted(reversed_at, np.arange(len(rate)), side="right") - 1
    since = np.concatenate(([0.0], total[reversed_at]))
    return np.asarray(total - since[last + 1])


# ---- the pages


def page(effect: Effect, note: Note) -> str:
    """Markdown text of the page of one effect."""
    parts = [
        _MADE,
        f"# {_capital(effect.title)}",
        f"`{effect.id}` · [all effects]({INDEX})",
        f"![{_capital(effect.title)}: a step, a sine and the residual torque]({effect.id}.png)",
        _caption(effect, note),
        _wrapped(note.text),
        "## Equation",
        *_forms(effect),
        "## Signature in the residuals",
        *_fingerprints(effect),
        "## Confused with",
        "\n".join(_rivals(effect)),
        "## Typical sizes",
        "\n".join(_item(size) for size in note.sizes),
    ]
    if note.left_out:
        parts.append(_wrapped(f"Error without this effect ([simulated]({INDEX}#sizes)): {note.left_out}"))
    return "\n\n".join(parts) + "\n"


def _caption(effect: Effect, note: Note) -> str:
    step, sine = runs_with(effect, note)
    sizes = ", ".join(
        f"{_words(parameter.name)} {note.values[parameter.name]:g}{_spaced(parameter.unit, volts=True)}"
        for parameter in effect.parameters
    )
    torque = max(float(np.max(np.abs(course.torque))) for course in (step, sine))
    peak = max(float(np.max(np.abs(course.left))) for course in (step, sine))
    legs = (
        f"{note.volts:g} V on the {_THRUSTER} thruster only, then on the other only"
        if note.alone
        else f"{note.volts:g} V forward, {_number(round(reverse(note.volts), 2))} V reverse"
    )
    text = (
        f"Step: {legs}, no command, {note.hold:g} s each. Size: {sizes}{_of(effect)}{_beside(note)}. The residual "
        f"torque is up to {_rounded(peak)} N m, the torque of the thrusters up to {_rounded(torque)} N m. "
        f"[How the plots are made]({INDEX}#pictures)."
    )
    return _wrapped(text)


def _beside(note: Note) -> str:
    """Speeds and stiffness in the plot."""
    ways = [
        f"{_number(speed)} m/s {way}"
        for speed, way in zip(note.speeds, ("ahead", "to starboard"), strict=True)
        if speed
    ]
    held = f", at {' and '.join(ways)}" if ways else ""
    return held + (f", with K = {note.stiffness:g} N m/rad" if note.stiffness else "")


def _of(effect: Effect) -> str:
    return f" of the {_THRUSTER} thruster" if effect.per_thruster else ""


def _forms(effect: Effect) -> Iterator[str]:
    before: tuple[EffectParameter, ...] = ()
    for form in forms_of(effect):
        place = _OF_ANGLES if form in ANGLE_FORMS else _PLACES[type(form.acts)]
        needs = f"; needs {' and '.join(f'`{name}`' for name in form.needs)} in the log" if form.needs else ""
        yield f"**`{form.key}`**: {place}{needs}."
        yield f"```text\n{form.equation}\n```"
        if _rows(form.parameters) != _rows(before):
            yield "\n".join(_rows(form.parameters))
        before = form.parameters
    if effect.per_thruster:
        yield "NAME is the name of a thruster in `rovid.toml`."


def _rows(parameters: Sequence[EffectParameter]) -> list[str]:
    rows = ["| parameter | unit | no effect at | range |", "|---|---|---|---|"]
    for index, parameter in enumerate(parameters):
        # The first parameter is a size, and so are further parameters with these names.
        sizes = index == 0 or any(part in parameter.name for part in _SIZES)
        null = _null(parameter) if sizes else "–"
        rows.append(f"| {parameter.name} | {_unit(parameter.unit)} | {null} | {_range(parameter)} |")
    return rows


def _null(parameter: EffectParameter) -> str:
    return "no limit" if parameter.neutral >= 1e5 else f"{parameter.neutral:g}"


def _range(parameter: EffectParameter) -> str:
    """Bounds in the parameter's unit. Bounds that depend on the vehicle's scale: only the sign."""
    if parameter.name.endswith("phase"):
        return "any"
    if parameter.scale == "one":
        return f"{_number(parameter.low)} to {_number(parameter.high)}"
    if parameter.low > 0.0:
        return "above 0"
    return "0 or more" if parameter.low == 0.0 else "either sign"


def _fingerprints(effect: Effect) -> Iterator[str]:
    yield _wrapped(_capital(effect.fingerprint) + ".")
    for form in forms_of(effect)[1:]:
        if form.fingerprint != effect.fingerprint:
            yield _wrapped(f"`{form.key}`: {form.fingerprint}.")
    yield _wrapped(f"Data that reveal the effect best: {effect.experiment}.")
    for form in forms_of(effect)[1:]:
        if form.experiment != effect.experiment:
            yield _wrapped(f"`{form.key}`: {form.experiment}.")


def _rivals(effect: Effect) -> Iterator[str]:
    yield "| effect | data that separate the two |"
    yield "|---|---|"
    for name in effect.rivals:
        yield f"| {_link(name)} | {_cell(_run(effect, _plain(name)))} |"
    others = [other.id for other in CATALOGUE if effect.id in other.rivals and other.id not in effect.rivals]
    if others:
        yield ""
        *most, last = map(_link, others)
        named = f"{', '.join(most)} and {last}" if most else last
        yield _wrapped(f"The effect is also confused with {named}.")


def _run(effect: Effect, rival: Effect) -> str:
    """Data that separate the two; if unknown, the data that reveal either."""
    runs = dict.fromkeys((effect.experiment, rival.experiment))
    return DISCRIMINATING_RUNS.get(frozenset({effect.id, rival.id}), "; ".join(runs))


def planar_page(effect: Effect, note: Mapping[str, Any]) -> str:
    """Markdown text of the page of an effect that only the planar model has."""
    parts = [
        _MADE.replace("notes.toml", PLANAR_NOTES.name),
        f"# {_capital(effect.title)}",
        f"`{effect.id}` · [all effects]({INDEX})",
        _wrapped(" ".join(note["text"].split())),
        "## Equation",
        *_forms(effect),
        "## Signature in the residuals",
        *_fingerprints(effect),
        "## Confused with",
        "\n".join(_rivals(effect)),
        "## Typical sizes",
        "\n".join(_item(size) for size in note["sizes"]),
    ]
    return "\n\n".join(parts) + "\n"


def planar_effects() -> list[Effect]:
    """Plain forms of the effects that only the planar model has."""
    known = {effect.id for effect in CATALOGUE}
    return [form for form in PLANAR_FORMS if not form.form and form.id not in known]


def index() -> str:
    """Markdown text of the index."""
    rows = ["| effect | looks like | confused with |", "|---|---|---|"]
    rows += [
        f"| {_link(effect.id)} | {_cell(effect.fingerprint)} | {', '.join(_link(name) for name in effect.rivals)} |"
        for effect in CATALOGUE
    ]
    gallery = [
        f"[![{_capital(effect.title)}]({effect.id}.png)]({effect.id}.md)\n\n{_link(effect.id)}" for effect in CATALOGUE
    ]
    parts = [
        _MADE,
        "# Effects",
        _wrapped(
            f"rovid's base model is {_BASE}. The catalogue contains {len(CATALOGUE)} effects that extend it. Each "
            "effect has a page: the equation of every form, its signature in the residuals, confusable effects, the "
            "run that decides, and typical sizes. `rovid fit --effect ID` estimates an effect with inertia and drag. "
            "Name a form other than the default as `ID:form`."
        ),
        "\n".join(rows),
        "## Reading an equation",
        _wrapped(
            "u is a thruster's command, F its thrust, T the yaw torque of all thrusters, r the yaw rate, ψ the "
            "heading, I the inertia with added inertia, DQ and DL quadratic and linear drag. A primed quantity "
            "replaces the unprimed one. An equation that begins with a sign is a torque on the right-hand side of "
            f"{_BASE}. In roll and pitch r is the rate of the axis, θ the tilt, and the left-hand side also contains "
            "K·sin(θ − θ0). “No effect at” is the neutral value; a dash marks a parameter without influence if the "
            "first parameter is neutral. Ranges are the bounds of a fit."
        ),
        "## Pictures",
        _wrapped(
            f"All plots are simulations with I = {_INERTIA:g} kg m², DQ = {_QUADRATIC:g} N m s²/rad², DL = {_LINEAR:g} "
            "N m s/rad and the thrust curve of `sample_logs/rosub_tank`, without noise. The effects are larger than "
            "their typical sizes. Both thrusters get the same command, unless stated otherwise; the reverse command "
            f"gives the same torque as the forward command. The sine has peaks of {_SINE:g} and "
            f"{_number(round(reverse(_SINE), 2))} V. Time starts at the first command."
        ),
        _wrapped(
            f"The residual torque is {_RESIDUAL} of the run with the effect, with T of the bench curve. A positive "
            "value means that the base model has too much torque. Inertia and drag are the true values. A fit to the "
            "run would change them and absorb part of the residual."
        ),
        "## Sizes",
        _wrapped(
            "“Work class” is a vehicle like ROSUB 6000: 5000 kg m² and 126 N m in use at 0.17 rad/s. A BlueROV2 has "
            "0.3 to 0.6 kg m² and 1.5 N m at 1 rad/s. Estimates are marked; the other values were measured, published "
            "or computed as stated."
        ),
        _wrapped(
            "“Error without this effect” is the error of the fitted inertia and drag if a ROSUB-like vehicle has the "
            "effect and the model does not: noise-free simulation, five forward steps of 150 s and two sines of 40 s."
        ),
        "## Planar model",
        _wrapped("These effects couple surge, sway and yaw, and exist with `--axes planar` only:"),
        "\n".join(f"* {_link(effect.id)}: {effect.fingerprint}" for effect in planar_effects()),
        "## Gallery",
        *gallery,
    ]
    return "\n\n".join(parts) + "\n"


def pages() -> dict[str, str]:
    """Text of every page by file name."""
    told = notes()
    with PLANAR_NOTES.open("rb") as file:
        of_planar = tomllib.load(file)
    planar = {f"{effect.id}.md": planar_page(effect, of_planar[effect.id]) for effect in planar_effects()}
    return {INDEX: index()} | {f"{effect.id}.md": page(effect, told[effect.id]) for effect in CATALOGUE} | planar


def _link(name: str) -> str:
    return f"[{_plain(name).title}]({name}.md)"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _cell(text: str) -> str:
    """Text of a table cell, with escaped bars."""
    return text.replace("|", "\\|")


def _words(name: str) -> str:
    return name.replace("_", " ")


def _unit(unit: str, *, volts: bool = False) -> str:
    known = {"1": "–", "command": "V" if volts else "command", "command/s": "V/s" if volts else "command/s"}
    return known.get(unit, unit.replace("^0.5", "^½").replace("^2", "²").replace("^3", "³"))


def _spaced(unit: str, *, volts: bool) -> str:
    return "" if unit == "1" else f" {_unit(unit, volts=volts)}"


def _number(value: float) -> str:
    return f"{value:g}".replace("-", "−")


def _rounded(value: float) -> str:
    """Two significant digits."""
    return f"{float(f'{value:.2g}'):g}"


def _wrapped(text: str) -> str:
    return textwrap.fill(text, _COLUMNS, break_long_words=False, break_on_hyphens=False)


def _item(text: str) -> str:
    return textwrap.fill(
        text, _COLUMNS, initial_indent="* ", subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )


def main() -> None:
    """Write all pages, and the plots of the named effects, or of all."""
    ids = [effect.id for effect in CATALOGUE]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ids", nargs="*", metavar="ID", help="effects to draw; default: all")
    chosen = parser.parse_args().ids or ids
    try:
        for name in chosen:
            if name not in ids:
                raise ConfigError(f"{name!r} is not the id of an effect. {suggestion(name, ids)}", where="ID")
        told, texts = notes(), pages()
    except RovidError as error:
        parser.exit(2, f"{error}\n")
    for name, text in texts.items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    for name in chosen:
        (FOLDER / f"{name}.png").write_bytes(render_png(picture(_plain(name), told[name])))


if __name__ == "__main__":
    main()
