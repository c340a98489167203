"""Plug-ins: effects of users, in files that they name or in packages that they install; docs/own_effects.md.

A plug-in has the form of a file of the catalogue. The code of a plug-in runs only if the user names its file, or
installs a package with the entry point group ``rovid.effects``. A broken plug-in is left out with a warning.
"""

import contextlib
import hashlib
import importlib.util
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from rovid.core.errors import ConfigError, display_text
from rovid.core.input_files import require_regular
from rovid.effects import templates
from rovid.effects.actuator_inputs import ActuatorInputs
from rovid.effects.base import (
    TERM_PARAMETERS,
    TERM_STATES,
    Body,
    Effect,
    EffectParameter,
    Instant,
    OnCommand,
    OnHeading,
    OnThrust,
    OnTorque,
    Scales,
    Term,
)
from rovid.effects.further_terms import address_of

GROUP = "rovid.effects"
_ID = re.compile(r"[a-z][a-z0-9_]*")
# An instant of a turn, in SI, at which terms are tried.
_AT = Instant(0.1, 0.1, 1.0, 0.4, 50.0, 7.0, 0.5, 0.1, Body(5000.0, 3500.0, 130.0))
# Scales at which effects are tried.
_SCALES = Scales(command=2.0, torque=100.0, rate=0.1, wash=10.0)
# Largest change by an effect that is not there, in N m, N, rad or the unit of the command.
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where an effect comes from that is not of the catalogue."""

    plugin: str  #: File name, or name of the installed package.
    version: str  #: ``__version__`` of the file or else a digest of its content; version of the package.

    @property
    def mend(self) -> str:
        """How the plug-in is loaded."""
        if self.plugin.endswith(".py"):
            return f"Give --effects-from {self.plugin}."
        return f"Install {self.plugin} next to rovid."


@dataclass
class _Loaded:
    """What this process has loaded."""

    forms: tuple[Effect, ...] = ()
    origins: dict[str, Origin] | None = None  #: By effect id; None until installed plug-ins are loaded.
    warnings: tuple[str, ...] = ()
    contents: frozenset[bytes] = frozenset()  #: Of the files, each of which is loaded once.


_LOADED = _Loaded()


class _InvalidPluginError(Exception):
    """The plug-in does not follow the rules; the text is a sentence without its end."""


def is_id(name: str) -> bool:
    """Whether an effect may have this id."""
    return _ID.fullmatch(name) is not None


def new_files(name: str) -> dict[str, str]:
    """File name -> text of a new effect ``name`` and of its test."""
    folder = Path(templates.__file__).parent
    texts = {f"{name}.py": "own_effect.py", f"test_{name}.py": "own_effect_check.py"}
    return {
        path: (folder / template).read_text(encoding="utf-8").replace("own_effects", "own#effects")
        .replace("own_effect", name).replace("own#effects", "own_effects")
        for path, template in texts.items()
    }  # fmt: skip


def forms_of(path: Path) -> tuple[Effect, ...]:
    """The forms that were loaded from the file at ``path``. Raises ConfigError if the plug-in was left out."""
    forms = tuple(form for form in _LOADED.forms if (_LOADED.origins or {})[form.id].plugin == path.name)
    if not forms:
        raise ConfigError("holds no effect that can be used; the reason stands above.", where=path, mend="Correct it.")
    return forms


def load_files(paths: Sequence[Path], taken: Sequence[str]) -> None:
    """Add the effects of the files at ``paths`` to those of the catalogue, the ids of which are ``taken``.

    Raises ConfigError if a file does not exist.
    """
    further_forms(taken)
    for path in paths:
        require_regular(path)
        if not path.is_file():
            mend = "Give the Python file of an effect; `rovid effect new NAME` writes one."
            raise ConfigError("there is no such file.", where=path, mend=mend)
        content = path.read_bytes()
        if content not in _LOADED.contents:
            _LOADED.contents |= {content}
            _add(path.name, taken, partial(_of_file, path, content))


def further_forms(taken: Sequence[str]) -> tuple[Effect, ...]:
    """All forms of all effects outside the catalogue."""
    if _LOADED.origins is None:
        _LOADED.origins = {}
        for entry in metadata.entry_points(group=GROUP):
            _add(entry.dist.name if entry.dist else entry.name, taken, partial(_of_entry, entry))
    return _LOADED.forms


def plugin_warnings() -> tuple[str, ...]:
    """A sentence on each plug-in that was left out."""
    return _LOADED.warnings


def origin(effect_id: str) -> Origin | None:
    """Where a loaded effect comes from; None for one of the catalogue."""
    return (_LOADED.origins or {}).get(effect_id)


def require_origins(origins: Mapping[str, Origin], where: Path) -> None:
    """Refuse values that were fitted with a plug-in that is not loaded, or with another version.

    Raises ConfigError. The message names the effect, the plug-in and its version.
    """
    for name, fitted in origins.items():
        loaded = origin(name)
        if loaded is None:
            text = f"holds the effect {name} of the plug-in {fitted.plugin} (version {fitted.version})"
            raise ConfigError(f"{text}, which is not loaded.", where=where, mend=fitted.mend)
        if loaded.version != fitted.version:
            raise ConfigError(
                f"holds values of the effect {name} that were fitted with version {fitted.version} of {fitted.plugin}. "
                f"Version {loaded.version} is loaded.",
                where=where,
                mend=f"Run `rovid fit --effect {name}` again, or give the version that the values were fitted with.",
            )


def _add(name: str, taken: Sequence[str], load: Callable[[], tuple[tuple[Effect, ...], str]]) -> None:
    """Add a plug-in, or the warning that it is left out."""
    assert _LOADED.origins is not None  # noqa: S101 - for mypy
    try:
        # What a plug-in prints would spoil the JSON document.
        with contextlib.redirect_stdout(sys.stderr):
            forms, version = load()
            for form in forms:
                _check(form, [*taken, *_LOADED.origins])
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # noqa: BLE001 - a plug-in may raise anything, SystemExit too
        reason = str(error) if isinstance(error, _InvalidPluginError) else f"{type(error).__name__}: {error}"
        reason = display_text(" ".join(reason.split())[:300])
        text = f"{display_text(name)}: this plug-in was left out: {reason.rstrip('.')}."
        _LOADED.warnings += (text,)
        sys.stderr.write(f"rovid: warning: {text}\n")
        return
    _LOADED.forms += forms
    _LOADED.origins |= {form.id: Origin(plugin=name, version=version) for form in forms}


def _of_file(path: Path, content: bytes) -> tuple[tuple[Effect, ...], str]:
    spec = importlib.util.spec_from_loader(f"rovid_plugin_{path.stem}", None, origin=str(path))
    assert spec is not None  # noqa: S101 - for mypy
    module = importlib.util.module_from_spec(spec)
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # dataclasses look their module up there
    exec(compile(content, path, "exec"), module.__dict__)  # noqa: S102 - the user named this file
    version = getattr(module, "__version__", None)
    return _forms(module), str(version or f"sha256:{hashlib.sha256(content).hexdigest()[:12]}")


def _of_entry(entry: metadata.EntryPoint) -> tuple[tuple[Effect, ...], str]:
    return _forms(entry.load()), entry.dist.version if entry.dist else "unknown"


def _forms(found: Any) -> tuple[Effect, ...]:
    if isinstance(found, ModuleType):
        found = getattr(found, "FORMS", None) or getattr(found, "EFFECT", None)
    forms = (found,) if isinstance(found, Effect) else found
    if not isinstance(forms, tuple | list) or not forms or not all(isinstance(form, Effect) for form in forms):
        raise _InvalidPluginError("it has no EFFECT of the class rovid.effects.base.Effect")
    return tuple(forms)


def _check(effect: Effect, taken: Sequence[str]) -> None:
    """Raise if the effect does not follow the rules, by trying it at an instant."""
    if not is_id(effect.id):
        raise _InvalidPluginError(f"the id {effect.id!r} has other signs than lower-case letters, digits and _")
    if effect.id in taken:
        raise _InvalidPluginError(f"the id {effect.id} is taken by another effect")
    if not effect.parameters:
        raise _InvalidPluginError("the effect has no parameters")
    for parameter in effect.parameters:
        _check_parameter(parameter)
    if len({parameter.name for parameter in effect.parameters}) < len(effect.parameters):
        raise _InvalidPluginError("two parameters have the same name")
    for position, absent in enumerate([*[False] * len(effect.initial_values), True]):
        start = effect.initial_values[0 if absent else position]
        sizes = np.array(list(map(_SCALES.unit_size, effect.parameters)))
        values = start * sizes
        if absent:
            size = slice(effect.size_count)
            values[size] = [parameter.neutral for parameter in effect.parameters[size]] * sizes[size]
        change = _change(effect, values)
        if not math.isfinite(change):
            raise _InvalidPluginError(f"the effect gives {change} at {effect.values(values)}")
        # A limit on changes needs finer instants than these to vanish.
        if absent and change > _ROUNDING and not effect.parameters[0].neutral_at_infinity:
            raise _InvalidPluginError(f"the effect is not zero at the neutral value of {effect.parameters[0].name}")
    if isinstance(effect.acts, Term):
        address_of(effect)  # compiles the term


def _check_parameter(parameter: EffectParameter) -> None:
    numbers = (parameter.low, parameter.high, *parameter.initial_values)
    if not parameter.initial_values or not all(map(math.isfinite, numbers)):
        raise _InvalidPluginError(f"the bounds and initial values of {parameter.name} are not finite numbers")
    if not all(parameter.low <= number <= parameter.high for number in parameter.initial_values):
        raise _InvalidPluginError(f"an initial value of {parameter.name} is outside low and high")
    try:
        _SCALES.unit_size(parameter)
    except KeyError as error:
        raise _InvalidPluginError(f"the scale {parameter.scale!r} of {parameter.name} is unknown") from error


def _change(effect: Effect, numbers: np.ndarray[Any, Any]) -> float:
    """Largest size of what the effect changes: torque in N m, thrust in N, command, or heading in rad."""
    acts, values = effect.acts, effect.values(numbers)
    if isinstance(acts, Term):
        if len(numbers) > TERM_PARAMETERS or acts.states > TERM_STATES:
            raise _InvalidPluginError(f"a Term has {TERM_PARAMETERS} parameters and {TERM_STATES} states at most")
        if acts.entrained_rate is not None or acts.reset is not None:
            raise _InvalidPluginError("a Term of a plug-in cannot have entrained_rate or reset")
        torque, derivatives = acts.evaluate(_AT, (*numbers.tolist(),), (0.0,) * acts.states)
        if len(derivatives) != acts.states:
            raise _InvalidPluginError(f"the term returns {len(derivatives)} derivatives of {acts.states} states")
        return abs(float(torque)) if np.isfinite(derivatives).all() else math.nan
    if isinstance(acts, OnHeading):
        heading = np.linspace(0.0, 6.0, 5)
        change = np.asarray(acts.deviation(heading, values))
        return float(np.abs(change).max()) if change.shape == heading.shape else math.nan
    if not isinstance(acts, OnCommand | OnThrust | OnTorque):
        raise _InvalidPluginError(f"acts is a {type(acts).__name__}, which a plug-in cannot have")
    inputs = _inputs(effect)
    series = np.linspace(-40.0, 60.0, 5)
    given = series if isinstance(acts, OnTorque) else np.column_stack((series, series[::-1])) / 10.0
    changed = np.asarray(acts.change(inputs, given.copy(), values))
    if changed.shape != given.shape:
        raise _InvalidPluginError(f"the effect returns an array of shape {changed.shape} for one of {given.shape}")
    return float(np.abs(changed - given).max())


def _inputs(effect: Effect) -> ActuatorInputs:
    """Five instants of two thrusters, with the channels that the effect needs."""
    return ActuatorInputs(
        time=np.arange(5.0),
        neutral=np.zeros(2),
        arms=np.array([0.4, -0.4]),
        full_thrust=np.full(2, 100.0),
        names=("a", "b"),
        forward_share=np.full(2, 0.5),
        command_range=np.array([[-5.0, 5.0]] * 2),
        dead_zone=np.zeros((2, 2)),
        extras={name: np.linspace(10.0, 12.0, 5) for name in effect.needs},
        reference=dict.fromkeys(effect.needs, 11.0),
    )
