"""Run the commands of docs/tutorial.md and store the plots shown there.

Run from the checkout as ``python -m docs.make_pictures``. A test compares the stored plots with new ones. A browser, if
installed, takes the screenshots of the page.
"""

from __future__ import annotations

import base64
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
# Picture -> output path of the tutorial's commands.
PICTURES: Mapping[str, str] = {
    "misfit.png": "hidden/plots/diagnosis_gain.png",
    "missing_lag.png": "hidden/plots/missing_thruster_lag.png",
    "missing_reverse.png": "hidden/plots/missing_thrust_asymmetry.png",
    "steady_torque.png": "report/plots/steady_torque.png",
    "inertia.png": "report/plots/inertia.png",
    "sine_40s_a.png": "report/plots/trial_14_sine_40s_a_csv.png",
    "plan.png": "plan.png",
}
# Screenshot -> JavaScript to run first, and selector of the element to show.
SCREENS: Mapping[str, tuple[str, str]] = {
    "page.png": ("", "#summary"),
    "switches.png": ("document.querySelector('#viewer-causes input').click()", "#viewer-root"),
}
PAGE = "hidden/index.html"
# Screenshot of `rovid open`: file, height in pixels, logs of the sample day.
OPEN = ("open.png", 1100, ("hold_02.csv", "hold_03.csv", "sine_40s_a.csv", "staircase.csv", "thrust_curve.csv"))


def has_browser() -> bool:
    """Whether a browser with remote control is available."""
    try:
        from tests.present.chromium import find_chromium
    except ImportError:  # remote control needs POSIX pipes
        return False
    return find_chromium() is not None


def screens(page: Path, folder: Path) -> None:
    """Write screenshots of ``page`` into ``folder``."""
    from tests.present.chromium import chromium

    with tempfile.TemporaryDirectory() as profile, chromium(Path(profile), "--hide-scrollbars") as tab:
        tab.call("Emulation.setDeviceMetricsOverride", width=1280, height=800, deviceScaleFactor=1, mobile=False)
        tab.call("Emulation.setEmulatedMedia", media="", features=[{"name": "prefers-color-scheme", "value": "light"}])
        for name, (action, part) in SCREENS.items():
            tab.open(page)
            tab.ask(f"{action}; new Promise(requestAnimationFrame)")
            place = tab.ask(
                f"(() => {{ const box = document.querySelector({part!r}).getBoundingClientRect();"
                " return { x: box.x, y: box.y + scrollY, width: box.width, height: box.height, scale: 1 }; })()"
            )
            taken = tab.call("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=place)
            (folder / name).write_bytes(base64.b64decode(taken["data"]))


def screen_of_open(folder: Path) -> None:
    """Write the screenshot of `rovid open` into ``folder``."""
    from tests.app.served import served
    from tests.present.chromium import chromium

    picture, height, logs = OPEN
    with tempfile.TemporaryDirectory() as name:
        day = Path(name, "trials", "my_logs")
        day.mkdir(parents=True)
        for log in logs:
            shutil.copy(HERE.parent / "sample_logs" / "rosub_tank" / log, day)
        with served(day.parent, "my_logs") as server, chromium(Path(name, "profile"), "--hide-scrollbars") as tab:
            tab.call("Emulation.setDeviceMetricsOverride", width=1280, height=height, deviceScaleFactor=1, mobile=False)
            features = [{"name": "prefers-color-scheme", "value": "light"}]
            tab.call("Emulation.setEmulatedMedia", media="", features=features)
            tab.call("Page.navigate", url=server.address)
            tab.until("Boolean(document.querySelector('#now-title:is(.go, .care)'))")
            # Hide the path of this machine.
            tab.ask("for (const id of ['where', 'top']) document.getElementById(id).textContent = '/home/me/trials'")
            tab.ask("scrollTo(0, 0); new Promise(requestAnimationFrame)")
            taken = tab.call("Page.captureScreenshot", format="png")
            (folder / picture).write_bytes(base64.b64decode(taken["data"]))


def main() -> None:
    """Write all plots and screenshots."""
    text = (HERE / "tutorial.md").read_text(encoding="utf-8")
    FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "sample_logs").symlink_to(HERE.parent / "sample_logs")
        for command in re.findall(r"^\$ rovid (.*)$", text, re.MULTILINE):
            sys.stdout.write(f"rovid {command}\n")
            words = [sys.executable, "-c", "from rovid.cli.cli import main; main()", *shlex.split(command)]
            subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)  # noqa: S603 - the page's own
        for picture, made in PICTURES.items():
            shutil.copy(folder / made, FOLDER / picture)
        if has_browser():
            screens(folder / PAGE, FOLDER)
            screen_of_open(FOLDER)
        else:
            sys.stdout.write(f"no browser: {', '.join((*SCREENS, OPEN[0]))} are unchanged\n")


if __name__ == "__main__":
    main()
