"""A parameter file changed, and its history with it, while another process may change them too."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from rovid.core.atomic_write import Content, OutputFile, OutputSet
from rovid.core.errors import ConfigError
from rovid.core.signatures import PARAMETERS
from rovid.store.history import appended_history, history_output
from rovid.store.load import read_parameters
from rovid.store.parameter_file import Parameters


def update_parameters(
    stored: Parameters,
    claim: OutputSet,
    change: Callable[[Parameters], Parameters],
    *,
    seen: Mapping[str, float] | None = None,
) -> Parameters:
    """Make ``change`` to what the file holds now, another process' results included; return what was written.

    With ``seen``, as `Record` has it, the history gets a line of that: both are written, or none.

    Raises
    ------
    OutputError
        They cannot be written, or what came to stand there is no parameter file of this axis, or no history; it says
        where the result is instead.
    """
    written = stored

    def changed() -> str:
        nonlocal written
        written = change(_as_it_is_now(stored))
        return written.text()

    contents: dict[OutputFile, Content] = {stored.output: changed}
    if seen is not None:
        # Made behind the other, of what that came to be.
        contents[history_output(stored.path)] = lambda: appended_history(written, seen)
    try:
        claim.write(contents)
    except ConfigError as error:
        claim.save_elsewhere({stored.output: change(stored).text().encode()}, error)
    return written


def _as_it_is_now(stored: Parameters) -> Parameters:
    # One that was deleted meanwhile, or replaced where that was asked for, begins with what was read of it.
    if not stored.path.exists() or not PARAMETERS.matches(stored.path):
        return stored
    now = read_parameters(stored.path)
    if now.axis is not stored.axis:
        raise ConfigError(f"holds the parameters of {now.axis.name} by now.", where=stored.path)
    return replace(now, path=stored.path)
