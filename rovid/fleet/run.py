"""Diagnosis of all campaigns of a fleet, and its results as a Parquet table, as JSON and on the terminal."""

import contextlib
import io
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from rich.console import Console

from rovid import __version__
from rovid.core.errors import ConfigError
from rovid.core.output_files import CAMPAIGN, FLEET_PAGE, FLEET_TABLE, OutputFile, OutputSet
from rovid.core.threads import core_count, thread_map
from rovid.fleet.campaigns import (
    CampaignRecord,
    CampaignTask,
    campaign_digest,
    diagnose_campaign,
    find_campaigns,
    read_record,
)
from rovid.fleet.page import cause_changes, caution, fleet_page, headline
from rovid.fleet.results import Fleet, ShrunkParameter, causes, guessed, outliers, shrink, verdict
from rovid.present.console import ResultTable, text_column

SCHEMA = "rovid-fleet/1"
_Column = tuple[Any, list[Any], str]


@dataclass(frozen=True, kw_only=True)
class FleetOutput:
    """The results, the written files and the number of campaigns diagnosed in this run."""

    fleet: Fleet
    table: Path
    page: Path
    diagnosed_anew: int


def parquet_table(fleet: Fleet, means: Sequence[ShrunkParameter]) -> bytes:
    """One row a campaign as Parquet, reproducible to the byte: the time that a diagnosis took is not included."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    records = fleet.records
    text, number, texts = pa.string(), pa.float64(), pa.list_(pa.string())
    starts = [None if one.start is None else datetime.fromtimestamp(round(one.start, 6), UTC) for one in records]
    # Name -> type, values, unit.
    columns: dict[str, _Column] = {
        "campaign": (text, [record.campaign for record in records], ""),
        "vehicle": (text, [record.vehicle for record in records], ""),
        "start": (pa.timestamp("us", tz="UTC"), starts, ""),
        "verdict": (text, list(map(verdict, records)), ""),
        "findings": (texts, [causes(record, "findings") for record in records], ""),
        "suspects": (texts, [causes(record, "suspects") for record in records], ""),
        "guessed": (texts, list(map(guessed, records)), ""),
    }
    for name in fleet.parameters:
        values = [fleet.values[record.campaign].get(name) for record in records]
        columns |= _parameter_columns(name, values, fleet.units[name], number)
    for mean in means:
        values = [mean.values.get(record.campaign) for record in records]
        columns |= _parameter_columns(f"{mean.name}_shrunk", values, fleet.units[mean.name], number)
    columns["seconds"] = (number, [record.seconds for record in records], "s")
    columns["error"] = (text, [record.error for record in records], "")
    metadata, fields, arrays = json.dumps({"schema": SCHEMA, "rovid": __version__, "axis": fleet.axis}), [], []
    for name, (kind, values, unit) in columns.items():
        fields.append(pa.field(name, kind, metadata={"unit": unit} if unit else None))
        arrays.append(pa.array(values, kind))
    schema = pa.schema(fields, metadata={"rovid": metadata})
    stream = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), stream, compression="zstd")
    return stream.getvalue()


def _parameter_columns(name: str, values: Sequence[Any], unit: str, kind: Any) -> dict[str, _Column]:
    """Columns of the values and of their standard errors."""
    errors = [value.error if value is not None and math.isfinite(value.error) else None for value in values]
    return {
        name: (kind, [None if value is None else value.value for value in values], unit),
        f"{name}_standard_error": (kind, errors, unit),
    }


def fleet_document(output: FleetOutput) -> dict[str, Any]:
    """The document of `rovid fleet --json`."""
    fleet = output.fleet
    far = [{"campaign": one.campaign, "parameter": one.name, "distance": one.distance} for one in outliers(fleet)]
    return {
        "schema": SCHEMA,
        "axis": fleet.axis,
        "table": str(output.table),
        "page": str(output.page),
        "diagnosed_anew": output.diagnosed_anew,
        "campaigns": list(map(_campaign_document, fleet.records)),
        "changes": list(cause_changes(fleet)),
        "outliers": far,
    }


def _campaign_document(record: CampaignRecord) -> dict[str, Any]:
    document: dict[str, Any] = {"campaign": record.campaign, "vehicle": record.vehicle}
    document["verdict"] = verdict(record)
    document |= {"findings": causes(record, "findings"), "suspects": causes(record, "suspects")}
    document |= {"guessed": guessed(record), "took_seconds": record.took, "peak_memory_bytes": record.peak_memory}
    return document | {"error": record.error}


def show_fleet(console: Console, output: FleetOutput) -> None:
    """Print one row a campaign, a summary line and the path of the page."""
    fleet = output.fleet
    rows = ResultTable("", *map(text_column, ("campaign", "vehicle", "verdict", "causes or error")))
    for record in fleet.records:
        found = record.error or ", ".join(causes(record, "findings")) or "–"
        words = (verdict(record) or "no diagnosis").replace("_", " ")
        rows.add_row(record.campaign, record.vehicle or "–", words, found)
    console.print(rows)
    console.print(headline(fleet))
    if warning := caution(fleet):
        console.print(warning, style="bold")
    console.print(str(output.page), highlight=False, soft_wrap=True)


# Time limit for the connection to a cluster, in s.
_CONNECT_TIMEOUT = 20.0


@dataclass(frozen=True, kw_only=True)
class FleetOptions:
    """Options of a fleet run."""

    # axis, cutoff: as for one campaign
    axis: str = "yaw"
    cutoff: float | None = None
    jobs: int | None = None  # Number of campaigns at a time; None: one per core
    cluster: str = ""  # Address of a Dask scheduler; empty: this machine
    patience: float = 3600.0  # Time limit for each campaign, in s
    shrink: bool = False  # Whether to compute hierarchical means of sister vehicles


def run_fleet(
    folders: Sequence[Path],
    out: Path,
    options: FleetOptions,
    *,
    force: bool = False,
    report: Callable[[str], None] = lambda _: None,
) -> FleetOutput:
    """Diagnose every campaign of ``folders`` and write the table and the page into ``out``.

    Each diagnosis is written as soon as it is finished. A later run does not repeat it. Raises ConfigError if a
    library, the folder or the cluster is missing. Raises OutputError if ``out`` cannot be written, or holds other files
    of these names.
    """
    for package in ("joblib", "pyarrow"):
        _require(package, f"-o {out}")
    campaigns = find_campaigns(folders, out)
    files = {name: OutputFile(out / "campaigns" / f"{name}.json", CAMPAIGN) for name in campaigns}
    table, page = OutputFile(out / "fleet.parquet", FLEET_TABLE), OutputFile(out / "index.html", FLEET_PAGE)
    claim = OutputSet([table, page, *files.values()], force=force)
    report("Looking for earlier results …")

    def task(name: str) -> CampaignTask:
        folder, axis, cutoff = campaigns[name], options.axis, options.cutoff
        digest = campaign_digest(folder, axis, cutoff)
        return CampaignTask(name=name, folder=str(folder), axis=axis, cutoff=cutoff, digest=digest)

    tasks = thread_map(task, list(campaigns))
    records = {record.campaign: record for record in _valid_records(tasks, files, out, claim, options.patience)}
    todo = [task for task in tasks if task.name not in records]
    for count, record in enumerate(_diagnose(todo, options, report), 1):
        claim.write({files[record.campaign]: record.text})
        records[record.campaign] = record.reduced
        report(f"{count} of {len(todo)} campaigns: {record.campaign} took {record.took:.0f} s …")
    fleet = Fleet(axis=options.axis, records=tuple(map(records.__getitem__, campaigns)))
    means: tuple[ShrunkParameter, ...] = shrink(fleet) if options.shrink else ()
    report("Writing the table and the page …")
    claim.write({table: parquet_table(fleet, means), page: fleet_page(fleet, means)})
    return FleetOutput(fleet=fleet, table=table.path, page=page.path, diagnosed_anew=len(todo))


def _valid_records(
    tasks: Sequence[CampaignTask], files: Mapping[str, OutputFile], out: Path, claim: OutputSet, patience: float
) -> list[CampaignRecord]:
    """Reduced records that are still valid; the record of a renamed campaign is written again under its new name."""
    paths = sorted(out.rglob("*.json"))
    by_digest = {record.digest: path for path in paths if (record := read_record(path)) is not None}
    valid, renamed = [], {}
    for task in tasks:
        output = files[task.name]
        for path in (output.path, by_digest.get(task.digest, output.path)):
            record = read_record(path)
            if record is not None and record.is_valid_for(task, patience):
                current = replace(record, campaign=task.name, folder=task.folder)
                if current != record or path != output.path:
                    renamed[output] = current.text
                valid.append(current.reduced)
                break
    # Written after all records are read, because two campaigns may have swapped their names.
    if renamed:
        claim.write(renamed)
    return valid


def _diagnose(
    tasks: Sequence[CampaignTask], options: FleetOptions, report: Callable[[str], None]
) -> Iterator[CampaignRecord]:
    """Records in the order in which the diagnoses finish."""
    if not tasks:
        return
    from joblib import Parallel, delayed, parallel_config

    from rovid.model.kernels import compile_all, is_compiled

    jobs, cores_each = options.jobs or core_count(), 1
    with contextlib.ExitStack() as stack:
        if options.cluster:
            jobs = stack.enter_context(_cluster(options))
        else:
            # The threads only wait for the processes that do the work.
            stack.enter_context(parallel_config(backend="threading"))
            cores_each = max(1, core_count() // min(jobs, len(tasks)))
            if not is_compiled():
                # Otherwise each process would compile.
                report("Compiling the simulation for this machine, once …")
                compile_all()
        report(f"Diagnosing {len(tasks)} campaigns, {jobs} at a time …")
        parallel = Parallel(n_jobs=jobs, batch_size=1, pre_dispatch="2*n_jobs", return_as="generator_unordered")
        try:
            yield from parallel(delayed(diagnose_campaign)(task, options.patience, cores_each) for task in tasks)
        except (OSError, CancelledError) as error:
            if not options.cluster:
                raise
            mend = "The campaigns that were finished are kept: start the cluster again, and repeat the command."
            text = "the Dask scheduler was lost."
            raise ConfigError(text, where=f"--cluster {options.cluster}", mend=mend) from error


@contextlib.contextmanager
def _cluster(options: FleetOptions) -> Iterator[int]:
    """Use the Dask cluster instead of this machine; yield the number of campaigns it diagnoses at a time.

    Raises ConfigError if there is no scheduler or no worker, or a worker has another version of rovid.
    """
    where = f"--cluster {options.cluster}"
    distributed = _require("distributed", where)
    from joblib import parallel_config

    try:
        client = distributed.Client(options.cluster, timeout=_CONNECT_TIMEOUT, set_as_default=True)
    except (OSError, ValueError, TimeoutError) as error:
        mend = "Give the address that `dask scheduler` prints, as tcp://127.0.0.1:8786."
        raise ConfigError("there is no Dask scheduler.", where=where, mend=mend) from error
    with client:
        threads = client.nthreads()
        if not threads:
            raise ConfigError("has no workers.", where=where, mend="Start some: `dask worker ADDRESS`.")
        for worker, version in client.run(_version).items():
            if version != __version__:
                found = f"rovid {version}" if version else "no rovid"
                raise ConfigError(f"worker {worker} has {found}; {__version__} was expected.", where=where)
        most = sum(threads.values())
        with parallel_config(backend="dask", wait_for_workers_timeout=_CONNECT_TIMEOUT):
            yield min(most, options.jobs or most)


def _version() -> str:
    """Version of rovid on a worker; empty if rovid is not installed there."""
    try:
        import rovid
    except ImportError:
        return ""
    return rovid.__version__


def _require(package: str, where: str) -> Any:
    try:
        return import_module(package)
    except ImportError as error:
        mend = "Install it with `pip install 'rovid[fleet]'`."
        raise ConfigError(f"needs the package {package}.", where=where, mend=mend) from error
