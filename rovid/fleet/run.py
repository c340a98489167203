"""All campaigns of a fleet: those that are done already, and the others on all cores or on a cluster."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from rovid import __version__
from rovid.core.atomic_write import OutputFile, OutputSet
from rovid.core.errors import ConfigError
from rovid.core.signatures import CAMPAIGN, FLEET_PAGE, FLEET_TABLE
from rovid.core.threads import core_count, thread_map
from rovid.fleet.campaign_record import CampaignRecord, CampaignTask, campaign_digest, read_record
from rovid.fleet.folders import CampaignFolder, find_campaigns
from rovid.fleet.page import fleet_page
from rovid.fleet.results import Fleet
from rovid.fleet.shrinkage import ShrunkParameter, shrink
from rovid.fleet.table import parquet_table
from rovid.fleet.worker import diagnose_campaign

# s to find a cluster.
_KNOCKING = 20.0
_EXTRA = "Install it with `pip install 'rovid[fleet]'`."


@dataclass(frozen=True, kw_only=True)
class FleetOptions:
    """How a fleet is diagnosed.

    Attributes
    ----------
    axis, cutoff
        As for one campaign.
    jobs
        Campaigns at a time; None: as many as there are cores.
    cluster
        Address of a Dask scheduler; empty: this machine.
    patience
        s that each campaign is given.
    shrink
        Whether sister vehicles are taken to be like each other.
    """

    axis: str = "yaw"
    cutoff: float | None = None
    jobs: int | None = None
    cluster: str = ""
    patience: float = 3600.0
    shrink: bool = False


@dataclass(frozen=True, kw_only=True)
class FleetOutput:
    """What a fleet came to, and where it is; ``anew`` counts the campaigns that were not done already."""

    fleet: Fleet
    table: Path
    page: Path
    diagnosed_anew: int


def run_fleet(
    folders: Sequence[Path],
    out: Path,
    options: FleetOptions,
    *,
    force: bool = False,
    report: Callable[[str], None] = lambda _: None,
) -> FleetOutput:
    """Diagnose every campaign of ``folders`` and write the table and the page into ``out``.

    Each campaign's diagnosis is written as soon as it is there, and is not made again.

    Raises
    ------
    ConfigError
        A library is missing, there is no such folder, or no such cluster.
    OutputError
        ``out`` cannot be written, or holds other files of these names.
    """
    for package in ("joblib", "pyarrow"):
        _require(package, f"-o {out}")
    places = find_campaigns(folders, out)
    files = {place.name: OutputFile(out / "campaigns" / f"{place.name}.json", CAMPAIGN) for place in places}
    table, page = OutputFile(out / "fleet.parquet", FLEET_TABLE), OutputFile(out / "index.html", FLEET_PAGE)
    claim = OutputSet([table, page, *files.values()], force=force)
    report("Looking for what is done already …")
    tasks = thread_map(lambda place: _task(place, options), places)
    records = {record.campaign: record for record in _done(tasks, files, out, claim, options.patience)}
    todo = [task for task in tasks if task.name not in records]
    for count, record in enumerate(_diagnosed(todo, options, report), 1):
        claim.write({files[record.campaign]: record.text})
        records[record.campaign] = record.reduced
        report(f"{count} of {len(todo)} campaigns: {record.campaign} took {record.took:.0f} s …")
    fleet = Fleet(axis=options.axis, records=tuple(records[place.name] for place in places))
    means: tuple[ShrunkParameter, ...] = shrink(fleet) if options.shrink else ()
    report("Writing the table and the page …")
    claim.write({table: parquet_table(fleet, means), page: fleet_page(fleet, means)})
    return FleetOutput(fleet=fleet, table=table.path, page=page.path, diagnosed_anew=len(todo))


def _done(
    tasks: Sequence[CampaignTask], files: Mapping[str, OutputFile], out: Path, claim: OutputSet, patience: float
) -> list[CampaignRecord]:
    """What holds already, lean; of a campaign by another name than last time it is written under the new one."""
    there = sorted(out.rglob("*.json"))
    by_digest = {record.digest: path for path in there if (record := read_record(path)) is not None}
    held, moved = [], {}
    for task in tasks:
        own = files[task.name]
        for path in (own.path, by_digest.get(task.digest, own.path)):
            record = read_record(path)
            if record is not None and record.is_valid_for(task, patience):
                now = replace(record, campaign=task.name, folder=task.folder)
                if now != record or path != own.path:
                    moved[own] = now.text
                held.append(now.reduced)
                break
    # Not before all are read: two campaigns may have changed their names with each other.
    if moved:
        claim.write(moved)
    return held


def _task(place: CampaignFolder, options: FleetOptions) -> CampaignTask:
    folder = place.folder
    return CampaignTask(
        name=place.name,
        folder=str(folder),
        axis=options.axis,
        cutoff=options.cutoff,
        digest=campaign_digest(folder, options.axis, options.cutoff),
    )


def _diagnosed(
    tasks: Sequence[CampaignTask], options: FleetOptions, report: Callable[[str], None]
) -> Iterator[CampaignRecord]:
    """Each as soon as it is there."""
    if not tasks:
        return
    from joblib import Parallel, delayed

    jobs = options.jobs or core_count()
    with contextlib.ExitStack() as stack:
        if options.cluster:
            jobs, each = stack.enter_context(_cluster(options)), 1
        else:
            stack.enter_context(_here())
            each = max(1, core_count() // min(jobs, len(tasks)))
            _compile(report)
        report(f"Diagnosing {len(tasks)} campaigns, {jobs} at a time …")
        # The work is done by processes that the threads wait for.
        parallel = Parallel(n_jobs=jobs, batch_size=1, pre_dispatch="2*n_jobs", return_as="generator_unordered")
        yield from parallel(delayed(diagnose_campaign)(task, options.patience, each) for task in tasks)


def _here() -> Any:
    from joblib import parallel_config

    return parallel_config(backend="threading")


@contextlib.contextmanager
def _cluster(options: FleetOptions) -> Iterator[int]:
    """The cluster in the place of this machine's cores; how many campaigns it does at a time.

    Raises
    ------
    ConfigError
        It is not there, has no worker, or one of another version.
    """
    where = f"--cluster {options.cluster}"
    distributed = _require("distributed", where)
    from joblib import parallel_config

    try:
        client = distributed.Client(options.cluster, timeout=_KNOCKING, set_as_default=True)
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
        with parallel_config(backend="dask", wait_for_workers_timeout=_KNOCKING):
            yield min(most, options.jobs or most)


def _version() -> str:
    """The version of rovid that a worker has; empty where it has none."""
    try:
        import rovid
    except ImportError:
        return ""
    return rovid.__version__


def _require(package: str, where: str) -> Any:
    try:
        return import_module(package)
    except ImportError as error:
        raise ConfigError(f"needs the package {package}.", where=where, mend=_EXTRA) from error


def _compile(report: Callable[[str], None]) -> None:
    """Once for all of the processes to come, each of which would do it by itself."""
    from rovid.model.kernels import compile_all, is_compiled

    if not is_compiled():
        report("Compiling the simulation for this machine, once …")
        compile_all()
