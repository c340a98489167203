"""Licences of what rovid needs or its extras bring: ``python -m tools.licences`` writes docs/licences.md."""

from __future__ import annotations

import contextlib
import tomllib
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, metadata, requires
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "licences.md"
# Texts of the licence field -> SPDX; a package that states none states it by its classifier.
_SPDX = {
    "Apache Software License": "Apache-2.0", "ISC License (ISCL)": "ISC", "any-OSI": "any that the OSI approves",
    "BSD": "BSD-3-Clause", "BSD License": "BSD-3-Clause", "3-Clause BSD License": "BSD-3-Clause", "MIT License": "MIT",
    "LGPLv3": "LGPL-3.0-or-later", "GNU Lesser General Public License v3 (LGPLv3)": "LGPL-3.0-or-later",
    "Python Software Foundation License": "PSF-2.0",
}  # fmt: skip


def requirements() -> dict[str, str]:
    """Each package that is installed with rovid -> the extra that brings it; empty for rovid itself."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found: dict[str, str] = {}

    def bring(text: str, extra: str, asked: Iterable[str] = ()) -> None:
        wanted = Requirement(text)
        name = wanted.name.lower().replace("_", "-")
        needed = any(not wanted.marker or wanted.marker.evaluate({"extra": one}) for one in ("", *asked))
        if not needed or name in {"rovid", *found}:
            return
        found[name] = extra
        with contextlib.suppress(PackageNotFoundError):
            for further in requires(name) or ():
                bring(further, extra, wanted.extras)

    for extra, texts in {"": project["dependencies"], **project["optional-dependencies"]}.items():
        for text in texts:
            bring(text, extra)
    return found


def licence(name: str) -> str:
    """Licence of an installed package by its own metadata, as SPDX where it is known."""
    try:
        told: Any = metadata(name)  # an email message
    except PackageNotFoundError:
        return ""
    classifiers = [one.split(" :: ")[-1] for one in told.get_all("Classifier") or [] if one.startswith("License")]
    free = str(told.get("License") or "").splitlines()
    for one in [told.get("License-Expression"), *classifiers, *free[:1]]:
        if one:
            return str(_SPDX.get(one, one))
    return "not stated"


def page(known: dict[str, str]) -> str:
    """Text of the page from name -> licence."""
    brought = requirements()
    rows = "\n".join(f"| {name} | {brought[name] or 'always'} | {known[name]} |" for name in sorted(known))
    copyleft = ", ".join(name for name, text in sorted(known.items()) if "GPL" in text)
    return f"""# Licences

rovid is under the MIT licence. It includes no code of the packages below. pip installs them with it, or with the extra:
those that pyproject.toml names, and those that these need in turn.
`python -m tools.licences` writes this page from the metadata of the installed packages.

One of them is under a copyleft licence: {copyleft}, an optional reader (extra `ardupilot`, also in `logs`). rovid calls
it unchanged. Whoever hands on a copy of it has to keep its licence. Without this extra all licences are permissive.

| package | installed with | licence |
| --- | --- | --- |
{rows}
"""


def main() -> None:
    """Write the page."""
    known = {name: text for name in requirements() if (text := licence(name))}
    PAGE.write_text(page(known), encoding="utf-8")


if __name__ == "__main__":
    main()
