"""Diagnosis of all campaigns of a fleet, on all cores or on a cluster. Valid earlier results are kept."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from rovid import __version__
from rovid.core.atomic_write import OutputFile, OutputSet
from rovid.core.errors import ConfigError
from rovid.core.signatures import CAMPAIGN, FLEET_PAGE, FLEET_TABLE
from rovid.core.threads import core_count, thread_map
from rovid.fleet.campaigns import CampaignRecord, CampaignTask, campaign_digest, find_campaigns, read_record
from rovid.fleet.output import FleetOutput, parquet_table
from rovid.fleet.page import fleet_page
from rovid.fleet.results import Fleet
from rovid.fleet.shrinkage import ShrunkParameter, shrink
from rovid.fleet.worker import diagnose_campaign

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

    Each diagnosis is written as soon as it is finished. A later run does not repeat it.

    Raises
    ------
    ConfigError
        A library, the folder or the cluster is missing.
    OutputError
        ``out`` cannot be written, or holds other files of these names.
    """
    for package in ("joblib", "pyarrow"):
        _require(package, f"-o {out}")
    campaigns = find_campaigns(folders, out)
    files = {name: OutputFile(out / "campaigns" / f"{name}.json", CAMPAIGN) for name in campaigns}
    table, page = OutputFile(out / "fleet.parquet", FLEET_TABLE), OutputFile(out / "index.html", FLEET_PAGE)
    claim = OutputSet([table, page, *files.values()], force=force)
    report("Looking for earlier results …")
    tasks = thread_map(lambda campaign: _task(*campaign, options), list(campaigns.items()))
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


def _task(name: str, folder: Path, options: FleetOptions) -> CampaignTask:
    axis, cutoff = options.axis, options.cutoff
    digest = campaign_digest(folder, axis, cutoff)
    return CampaignTask(name=name, folder=str(folder), axis=axis, cutoff=cutoff, digest=digest)


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
            raise ConfigError(
                "the Dask scheduler was lost.", where=f"--cluster {options.cluster}", mend=mend
            ) from error


@contextlib.contextmanager
def _cluster(options: FleetOptions) -> Iterator[int]:
    """Use the Dask cluster instead of this machine; yield the number of campaigns it diagnoses at a time.

    Raises
    ------
    ConfigError
        There is no scheduler or no worker, or a worker has another version of rovid.
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
