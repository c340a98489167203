"""Search for the campaigns of a fleet, and their names."""

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
    """A campaign: its unique name and its absolute path."""

    name: str
    folder: Path


def find_campaigns(folders: Sequence[Path], out: Path) -> list[CampaignFolder]:
    """Campaigns in ``folders``, sorted by name.

    A folder with a rovid.toml is one campaign, including its subfolders. Any other folder is searched for such
    folders. A folder with logs outside of every campaign counts as a campaign too, because its record then reports
    the missing rovid.toml. So does a given folder without any campaign. The output folder ``out`` is skipped.

    Raises
    ------
    ConfigError
        ``out`` lies in a campaign, or none of the folders exists.
    """
    if not any(folder.exists() for folder in folders):
        raise ConfigError("there is no such folder.", where=folders[0], mend="Give folders of campaigns.")
    out = _absolute(out)
    found = dict.fromkeys(campaign for folder in folders for campaign in _search(_absolute(folder), out))
    for folder in found:
        if out.resolve().is_relative_to(folder.resolve()):
            raise ConfigError(
                f"lies in the campaign {folder}. The results would be read as logs of that campaign.",
                where=f"-o {out}",
                mend="Choose a folder outside of the campaign.",
            )
    # A link to another folder of the list is not a second campaign.
    unique = {folder.resolve(): folder for folder in reversed(found)}
    names = _names(list(unique.values()))
    return [CampaignFolder(name, names[name]) for name in sorted(names)]


def _absolute(path: Path) -> Path:
    return Path(os.path.normpath(path.absolute()))


def _search(folder: Path, out: Path) -> Iterator[Path]:
    """Campaigns in one given folder."""
    campaigns: list[Path] = []
    log_folders: list[Path] = []
    if folder.is_dir() and not _is_campaign(folder):
        for name, subfolders, files in os.walk(folder):
            here = Path(name)
            if _is_campaign(here):
                campaigns.append(here)
                subfolders.clear()
                continue
            subfolders[:] = sorted(name for name in subfolders if not name.startswith(".") and here / name != out)
            if any(Path(name).suffix.lower() in READERS and not name.startswith(".") for name in files):
                log_folders.append(here)
    if not campaigns:
        yield folder
        return
    yield from campaigns
    # Folders of logs without a rovid.toml: the highest folder above each that contains no campaign.
    for here in log_folders:
        parents = [parent for parent in (here, *here.parents) if parent != folder and parent.is_relative_to(folder)]
        free = [parent for parent in parents if not any(campaign.is_relative_to(parent) for campaign in campaigns)]
        if free:
            yield free[-1]


def _is_campaign(folder: Path) -> bool:
    return (folder / FILE_NAME).is_file() or bool(special_kind(folder / FILE_NAME))


def _names(folders: Sequence[Path]) -> dict[str, Path]:
    """Folders by the shortest end of their path that is unique."""
    lengths = dict.fromkeys(folders, 1)
    while True:
        names = {folder: encodable("/".join(folder.parts[1:][-n:])) or "campaign" for folder, n in lengths.items()}
        counts = Counter(names.values())
        ambiguous = [folder for folder, name in names.items() if counts[name] > 1]
        if not ambiguous:
            return {name: folder for folder, name in names.items()}
        for folder in ambiguous:
            lengths[folder] += 1
