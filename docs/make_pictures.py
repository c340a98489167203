"""Run the commands of docs/tutorial.md and keep the pictures that the page shows.

Run from the checkout as ``python docs/make_pictures.py``. A test compares them with what the commands draw.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

HERE = Path(__file__).parent
FOLDER = HERE / "pictures"
# Picture -> where the commands of the tutorial write it.
PICTURES: Mapping[str, str] = {
    "steady_torque.png": "report/plots/steady_torque.png",
    "inertia.png": "report/plots/inertia.png",
    "sine_40s_a.png": "report/plots/trial_14_sine_40s_a_csv.png",
    "plan.png": "plan.png",
}


def main() -> None:
    """Write all of them anew."""
    text = (HERE / "tutorial.md").read_text(encoding="utf-8")
    FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "sample_logs").symlink_to(HERE.parent / "sample_logs")
        for command in re.findall(r"^\$ rovid (.*)$", text, re.MULTILINE):
            sys.stdout.write(f"rovid {command}\n")
            words = [sys.executable, "-c", "from rovid.commands.cli import main; main()", *shlex.split(command)]
            subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)  # noqa: S603 - the page's own
        for picture, made in PICTURES.items():
            shutil.copy(folder / made, FOLDER / picture)


if __name__ == "__main__":
    main()
