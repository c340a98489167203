"""Results as typed records. Printed, a record shows what its command prints, and has the same numbers."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console

from rovid.core.formatting import SafeConsole, plus_minus, to_json
from rovid.core.output_files import OutputSet
from rovid.estimate.estimate import Estimate
from rovid.export.verification import select_exporter
from rovid.present.number_format import unit_symbol
from rovid.store.parameter_file import Parameters
from rovid.trial.fault import Fault

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

# Columns of text in a notebook, and its look there.
_WIDTH = 110
_HTML = '<pre style="white-space:pre;overflow-x:auto;line-height:1.3;font-family:monospace">{code}</pre>'


@dataclass(frozen=True, kw_only=True)
class UncertainValue:
    """A parameter with its uncertainty; printed, it is rounded to its standard error."""

    value: float
    standard_error: float
    unit: str
    interval_95: tuple[float, float]

    def __str__(self) -> str:
        return f"{plus_minus(self.value, self.standard_error)} {unit_symbol(self.unit)}".rstrip()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Record:
    """What all results share. Printed, a record shows what its command prints."""

    document: dict[str, Any]  #: What the command prints with --json.
    show: Callable[[Console], None]
    draw: Callable[[Axes], None]
    table: Callable[[], pd.DataFrame]

    def to_json(self) -> str:
        """The document as JSON text; numbers that are not finite are null."""
        return to_json(self.document)

    def to_pandas(self) -> pd.DataFrame:
        """The main table: a row for each log, parameter, cause, candidate run, or part that a format does not hold."""
        return self.table()

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the main result into ``axes``, by default those of a new figure, and return them.

        A check draws the position in each log. A fit and a simulation draw the rate of the longest log, measured and
        simulated. A diagnosis draws the position error after a restart on runs that were not fitted. A cause draws its
        gain and the gains of its alternatives. A plan draws the commands, a comparison the ratios of all parameters,
        and an export its errors.

        Raises
        ------
        DataError
            There is nothing to draw.
        """
        if axes is None:
            from matplotlib import pyplot as plt

            _, axes = plt.subplots(figsize=(9.0, 3.6), layout="constrained")
        self.draw(axes)
        return axes

    def __repr__(self) -> str:
        return self._printed().export_text().rstrip()

    def _repr_html_(self) -> str:
        """The printed result with its colours, for notebooks."""
        return self._printed().export_html(inline_styles=True, code_format=_HTML)

    def _printed(self) -> SafeConsole:
        # In a notebook rich would show each paragraph by itself, besides what is recorded here.
        terminal = {"force_terminal": True, "force_jupyter": False, "legacy_windows": False}
        console = SafeConsole(record=True, width=_WIDTH, file=io.StringIO(), **terminal)
        self.show(console)
        return console


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CheckRecord(Record):
    """Result of `rovid check`."""

    verdict: Literal["go", "care", "no_go"]  #: Whether the logs are ready for a fit.
    faults: tuple[Fault, ...]  #: Faults of the logs, with their remedies.


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ModelRecord(Record):
    """Result of `rovid fit`; a diagnosis has the same fields, and more."""

    #: Parameter -> value, as ``inertia`` or ``thruster_lag.time_constant``; empty where there is no model.
    parameters: dict[str, UncertainValue]
    effects: tuple[str, ...]  #: Ids of the effects in the model.
    faults: tuple[Fault, ...]  #: Faults of the logs, with their remedies.
    warnings: tuple[str, ...]  #: Sentences on what limits the result.
    estimate: Estimate | None
    stored: Parameters  # As a parameter file would hold the model


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SimulationRecord(Record):
    """Result of `rovid simulate`."""

    simulations: Sequence[Any]  # Each run with its measurement and its simulation
    r2: dict[str, float]  #: Signal -> R^2 of its free-running simulation over all runs, as ``yaw_rate``.


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CauseRecord(Record):
    """An established or suspected cause of what the simulation gets wrong."""

    effect: str  #: Id of the effect, as ``thruster_lag``.
    parameters: dict[str, UncertainValue]  #: Parameter, without the effect's name -> value.
    confidence: float  #: Probability that this cause or an indistinguishable one acts.
    evidence: str  #: confirmed, likely or possible.
    cannot_be_told_from: tuple[str, ...]  #: Ids of the causes that these data do not rule out.

    def __repr__(self) -> str:
        sizes = ", ".join(f"{name} {value}" for name, value in self.parameters.items())
        return f"{self.effect} ({self.evidence}, {self.confidence:.2f}): {sizes}"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DiagnosisRecord(ModelRecord):
    """Result of `rovid diagnose`; ``parameters`` and ``effects`` are those of the extended model."""

    verdict: str  #: found, suspected, nothing_found, unexplained, too_little_data or bad_logs.
    findings: tuple[CauseRecord, ...]  #: Established causes, the largest gain first.
    suspects: tuple[CauseRecord, ...]  #: Likely or possible causes, the most probable first.


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlanRecord(Record):
    """Result of `rovid plan`."""

    decides: bool  #: Whether the best run is expected to distinguish the causes.
    #: The best run: time in s, and a command for each thruster; each row holds until the next.
    commands: pd.DataFrame


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ComparisonRecord(Record):
    """Result of `rovid compare`."""

    verdict: str  #: same, changed or cannot_tell.
    changed: tuple[str, ...]  #: Parameters that changed.


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ExportRecord(Record):
    """Result of `rovid export`: the content of a simulator's file, verified by re-simulation."""

    format: str
    content: str | bytes
    not_held: tuple[str, ...]  #: Parts of the model that the format cannot hold.

    def save(self, path: str | Path | None = None) -> Path:
        """Write the file, by default under the name of the format, and return its path.

        Raises
        ------
        RovidError
            There is a file of this name that rovid did not write, or the file cannot be written.
        """
        _, target = select_exporter(self.format, None if path is None else Path(path))
        OutputSet([target]).write({target: self.content})
        return target.path
