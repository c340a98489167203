"""Which campaigns there are in the folders that are given, and what each is called."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rovid.core.errors import ConfigError
from rovid.core.escaping import encodable
from rovid.core.paths import special_kind
from rovid.readers import READERS
from rovid.trial.config import FILE_NAME


@dataclass(frozen=True)
class CampaignFolder:
    """A campaign: what it is called, which is told from all others, and its folder, absolute."""

    name: str
    folder: Path


def find_campaigns(folders: Sequence[Path], out: Path) -> list[CampaignFolder]:
    """The campaigns of ``folders`` by name: each folder that holds a rovid.toml is one, with all that is below it.

    A folder without one is looked through for those that do. What is beside them there and holds logs is a campaign
    too, of which it will be said what it lacks; so is a folder in which there is nothing at all. ``out``, where the
    results go, is none.

    Raises
    ------
    ConfigError
        ``out`` lies in a campaign, which would take the results for logs; or none of the folders is there.
    """
    if not any(folder.exists() for folder in folders):
        raise ConfigError("there is no such folder.", where=folders[0], mend="Give folders of campaigns.")
    out = _absolute(out)
    found = dict.fromkeys(one for folder in folders for one in _below(_absolute(folder), out))
    for folder in found:
        if out.resolve().is_relative_to(folder.resolve()):
            raise ConfigError(
                f"lies in the campaign {folder}, which would take the results for its logs.",
                where=f"-o {out}",
                mend="Choose a folder outside of it.",
            )
    # A link to a folder that is there too is no second campaign.
    once = {folder.resolve(): folder for folder in reversed(found)}
    names = _names(list(once.values()))
    return [CampaignFolder(name, names[name]) for name in sorted(names)]


def _absolute(path: Path) -> Path:
    return Path(os.path.normpath(path.absolute()))


def _below(folder: Path, out: Path) -> Iterator[Path]:
    """The campaigns in one folder that was given."""
    if not folder.is_dir() or _is_campaign(folder):
        yield folder
        return
    campaigns, logs = [], []
    for here, inside, files in os.walk(folder):
        place = Path(here)
        if _is_campaign(place):
            campaigns.append(place)
            inside.clear()
            continue
        inside[:] = sorted(name for name in inside if not name.startswith(".") and place / name != out)
        if any(Path(name).suffix.lower() in READERS and not name.startswith(".") for name in files):
            logs.append(place)
    if not campaigns:
        yield folder
        return
    yield from campaigns
    yield from _lacking(folder, campaigns, logs)


def _lacking(folder: Path, campaigns: Sequence[Path], logs: Sequence[Path]) -> Iterator[Path]:
    """Folders with logs that belong to no campaign: the highest below ``folder`` in which there is none."""
    for place in logs:
        above = [one for one in (place, *place.parents) if one != folder and one.is_relative_to(folder)]
        free = [one for one in above if not any(other.is_relative_to(one) for other in campaigns)]
        if free:
            yield free[-1]


def _is_campaign(folder: Path) -> bool:
    return (folder / FILE_NAME).is_file() or bool(special_kind(folder / FILE_NAME))


def _names(folders: Sequence[Path]) -> dict[str, Path]:
    """Each by the end of its path, as much of it as tells it from all others."""
    ends = dict.fromkeys(folders, 1)
    while True:
        names = {folder: encodable("/".join(folder.parts[1:][-count:])) or "campaign" for folder, count in ends.items()}
        often = Counter(names.values())
        same = [folder for folder, name in names.items() if often[name] > 1]
        if not same:
            return {name: folder for folder, name in names.items()}
        for folder in same:
            ends[folder] += 1
