"""Logs that a copy of this process reads, while this one imports what it fits them with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rovid.core.spmd import ForkedCall
from rovid.readers.discover import are_large, find_logs, read_trials
from rovid.trial.axis import Axis
from rovid.trial.config import Config, find_config, load_config
from rovid.trial.trial import Remark, Trial

# Where they were found and what they are called -> trials, and what was remarked.
_Read = dict[tuple[Path, str], tuple[list[Trial], list[Remark]]]


class PrefetchedReader(ForkedCall[_Read]):
    """As `rovid.readers.discover.trials_of` reads a log; it is read here where the copy did not.

    Parameters
    ----------
    asked
        Says, in the copy, which paths are to be read and along which axis.
    meanwhile
        What this process does before it waits for the copy.
    """

    def __init__(self, asked: Callable[[], tuple[Sequence[Path], Axis]], meanwhile: Callable[[], object]) -> None:
        super().__init__(lambda: _read(*asked()))
        self._meanwhile = meanwhile
        self._known: _Read | None = None

    def __call__(self, path: Path, config: Config, name: str, remarks: list[Remark]) -> list[Trial]:
        """What is to be used of a log; ``remarks`` grow by what there is to say of it."""
        if self._known is None:
            if self.is_running:
                self._meanwhile()
            self._known = self.result() or {}
        # What was read is only kept by whom it is given to.
        trials, said = self._known.pop((path, name), (None, []))
        if trials is None:
            return read_trials(path, config, name, remarks)
        remarks += said
        return trials


def _read(paths: Sequence[Path], axis: Axis) -> _Read:
    """All logs, but for those that are so large that one waits for them."""
    config, read = load_config(find_config(paths), axis), _Read()
    logs, _ = find_logs(paths, config)
    if not are_large(logs):
        for name, path in logs:
            remarks: list[Remark] = []
            read[path, name] = read_trials(path, config, name, remarks), remarks
    return read
