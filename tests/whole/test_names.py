"""Names from anywhere (files, columns, thrusters, vehicles) steer no terminal, spoil no file and flood no message."""

from __future__ import annotations

import io
import json
import os
import re
import sys
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure
from scipy.io import loadmat

from rovid.cli import cli
from rovid.effects import effect_named
from rovid.export import FORMATS
from rovid.export.fossen import derivative
from rovid.export.gazebo import export_uuv_yaml
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.verification import load_exporter, verified_export
from rovid.model.model import Model
from rovid.present.page.page_files import template_environment
from rovid.present.plots import canvas
from rovid.store.parameter_file import Entry
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tests.conftest import Rovid
from tests.hostile import NAMES, STEERING
from tests.whole.test_bad_input import assert_one_message, folder  # noqa: F401 - a fixture


def subject(names: tuple[str, ...] = NAMES) -> ExportInput:
    curve = ThrustCurve(command=np.array([-5.0, 0.0, 5.0]), thrust=np.array([-100.0, 0.0, 200.0]))
    thrusters = tuple(Thruster(name=name, arm=0.1 + 0.01 * k, curve=curve) for k, name in enumerate(names))
    keys = [f"thruster_imbalance:{name}" for name in names if re.fullmatch(r"[\w ]+", name)]
    effects = tuple(effect_named(key) for key in keys)
    values = {
        "inertia": 5000.0,
        "quadratic_drag": 3000.0,
        "linear_drag": 100.0,
        **{f"{e.key}.gain": 0.9 for e in effects},
    }
    return ExportInput(
        model=Model(
            inertia=5000.0,
            quadratic_drag=3000.0,
            linear_drag=100.0,
            effects=effects,
            effect_values=(0.9,) * len(effects),
        ),
        vehicle=Vehicle(name=names[0] + names[3] + names[12] + names[13] + names[15], thrusters=thrusters),
        entries={n: Entry(value=v, standard_error=1.0, unit="1", method="m") for n, v in values.items()},
        largest_rate=0.3,
        commands=np.tile([-5.0, 5.0], (len(names), 1)),
        reference={},
    )


def read_xml(content: str) -> None:
    root = ET.fromstring(content)
    assert not STEERING.search(content)
    assert "${" not in content
    assert "$(" not in content
    for kind in ("link", "joint", "model/link", "model/joint", "robot/actuator", "actuator/general", "custom/numeric"):
        found = [element.get("name") for element in root.findall(f"./{kind}")]
        assert len(set(found)) == len(found)


def read_yaml(content: str) -> None:
    parameters = yaml.safe_load(content)["/**"]["ros__parameters"]
    assert parameters["thruster_names"] == list(NAMES)
    assert len(parameters["effects"]) == len(parameters["effect_names"])
    assert not STEERING.search(content)


def read_matlab(content: bytes) -> None:
    stream: Any = io.BytesIO(content)
    effects = loadmat(stream, simplify_cells=True)["rovid"]["effects"]
    assert len(effects) == len(subject().effects)


def read_json(content: str) -> None:
    assert [one["name"] for one in json.loads(content)["thrusters"]] == list(NAMES)
    assert not STEERING.search(content)


def read_python(content: str) -> None:
    compile(content, "vehicle.py", "exec")
    assert not STEERING.search(content)


def read_function(content: str) -> None:
    assert derivative(content)(np.zeros(2), np.zeros(1)).tolist() == [0.0, 0.0]
    assert not STEERING.search(content)


def read_parameters(content: str) -> None:
    """Lines of a name and a number, and comments, none of which ends early."""
    lines = [line.removeprefix("param set ") for line in content.splitlines() if line and not line.startswith("#")]
    assert lines
    for line in lines:
        name, value = re.split(r"[, ]", line)
        assert re.fullmatch(r"[A-Z0-9_]+", name)
        float(value)
    assert not STEERING.search(content)


ASSERT_READABLE: dict[str, Callable[[str], None] | Callable[[bytes], None]] = {
    **dict.fromkeys(("gz-sim", "uuv", "vrx", "stonefish", "mujoco"), read_xml),
    "ros2": read_yaml,
    "matlab": read_matlab,
    "json": read_json,
    "python-vehicle-simulator": read_python,
    "mss": read_function,
    "ardupilot": read_parameters,
    "px4": read_parameters,
}


@pytest.mark.parametrize("name", FORMATS)
def test_every_export_of_any_name_is_read_by_its_parser(name: str) -> None:
    made: ExportResult = load_exporter(name)(subject())
    assert made.content
    ASSERT_READABLE[name](made.content)  # type: ignore[arg-type]  # each takes what its format is


def test_the_python_export_still_runs_with_any_name() -> None:
    assert verified_export(load_exporter("python-vehicle-simulator"), subject(NAMES[:16])).mismatch.largest < 0.1


def test_the_yaml_of_uuv_holds_numbers_alone() -> None:
    assert yaml.safe_load(str(export_uuv_yaml(subject()).content))["mass"] == 1.0


@pytest.mark.parametrize("name", [*NAMES, os.fsdecode(b"\xff")])
def test_page_and_plots_hold_any_name(name: str) -> None:
    template = template_environment().from_string(
        "<p title='{{ name }}'>{{ name }}</p><script>{{ name|tojson }}</script>"
    )
    page = template.render(name=name)
    page.encode()
    assert not STEERING.search(page)
    assert page.count("<script>") == page.count("</script>") == 1
    figure = Figure(figsize=(2.0, 1.0))
    figure.suptitle(name)
    assert canvas.render_png(figure).startswith(b"\x89PNG")
    ET.fromstring(canvas.render_svg(figure))


def change(old: str, new: str) -> Callable[[Path], object]:
    def apply(campaign: Path) -> None:
        path = campaign / "rovid.toml"
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new, 1))

    return apply


SHADOW = "root:$6$salt$hash:19000:0:99999:7:::"
LONG = "k" * 100_000
CAMPAIGNS: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "400 digits": (change("2604.0", "9" * 400), ("mass", "64 bits")),
    "5000 digits": (change("2604.0", "9" * 5000), ("rovid.toml", "TOML", "digits")),
    "5000 digits in base 16": (change("2604.0", "0x" + "f" * 5000), ("vehicle.mass", "64 bits")),
    "digits in a list": (change('"fore"', f"[1, [{'9' * 400}]]"), ("thrusters.1.name.2.1", "64 bits")),
    "3000 arrays": (change("2604.0", "[" * 3000 + "]" * 3000), ("nested",)),
    "50 arrays": (change("2604.0", "[" * 50 + "]" * 50), ("nested",)),
    "a key of 100000 parts": (change("mass", ".".join(["a"] * 100_000)), ("nested",)),
    "a key of 40 spaced and quoted parts": (change("mass", ' . "b"'.join(["a"] * 40)), ("nested",)),
    "length": (change("2.6", "1e308"), ("length", "1e+308", "1e+18")),
    "width": (change("2.0", "1e-320"), ("width", "1e-12")),
    "arm": (change("0.86", "-1e300"), ("yaw_arm", "1e+18")),
    "sign": (change('"heading_deg",', '"heading_deg", sign = nan,'), ("sign", "nan")),
    "bad date": (change("2604.0", "2024-13-45"), ("rovid.toml", "TOML")),
    "5 MB": (lambda f: (f / "rovid.toml").write_text("#" * 5_000_000), ("larger than 4 MB",)),
    "no UTF-8": (lambda f: (f / "rovid.toml").write_bytes(b"\xff"), ("UTF-8",)),
    "key": (change("mass", LONG), ("vehicle", "not known here", "characters", "There are: 'name'")),
    "key that steers": (change("mass", r'"\u001b[31mmass"'), ("x1b[31mmass", "Nearest: 'mass'")),
    "thruster": (change('"fore"', f'"{LONG}"'), ("number 1 name", "100000 characters", "200")),
    "vehicle": (change('"v"', f'"{LONG}"'), ("[vehicle] name", "100000 characters")),
    "signal": (change("heading = ", f'{LONG} = "x"\nheading = '), ("[signals]", "100000 characters")),
    "column": (change('"heading_deg"', f'"{LONG}"'), ("hold_0.csv", "has no column", "There are: 'time_s'")),
    "column of the log": (
        lambda f: (f / "hold_0.csv").write_text(f"time_s,{LONG[:20_000]},fore_V\n0,1,1\n1,2,1\n"),
        ("hold_0.csv", "has no column 'heading_deg'", "'time_s'", "kkk"),
    ),
    "curve of a long name": (change('"curve.csv"', f'"{"c" * 300}.csv"'), ("ccc.csv", "there is no such")),
    "curve of 100 kB": (change('"curve.csv"', f'"{LONG}"'), ("kkk", "there is no such")),
    "curve with NUL": (change('"curve.csv"', r'"a\u0000b"'), ("no such thrust curve", r"a\x00b")),
    "cell of a curve": (
        lambda f: (f / "curve.csv").write_text(f"command,thrust_N\n0,0\n1,{LONG}\n"),
        ("curve.csv:3", "thrust_N is 'kkk", "a number was expected"),
    ),
    "field of a curve": (
        lambda f: (f / "curve.csv").write_text(f"command,thrust_N\n0,0\n1,{LONG}{LONG}\n"),
        ("curve.csv", "no table"),
    ),
    "thrust of a curve": (
        lambda f: (f / "curve.csv").write_text("command,thrust_N\n0,0\n5,1e300\n"),
        ("curve.csv:3", "1e300"),
    ),
    "curve of 65 MB": (lambda f: (f / "curve.csv").write_bytes(b"\n" * 65_000_000), ("larger than 64 MB",)),
}


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_no_campaign_ends_in_a_traceback_or_a_flood(name: str, folder: Path, rovid: Rovid) -> None:  # noqa: F811
    break_it, said = CAMPAIGNS[name]
    break_it(folder)
    done = rovid("fit-drag", folder)
    assert_one_message(done, *said)
    assert len(done.err) < 2100
    assert not STEERING.search(done.err)


@pytest.mark.parametrize(
    "text",
    [
        f"{SHADOW}\n{SHADOW}\n",
        f"{SHADOW.replace('hash', 'ha,sh')}\n{SHADOW.replace('hash', 'ha,sh')}\n",
        "-----BEGIN KEY-----\nMIIE\n",
        f"TOKEN={SHADOW}\nKEY=1\n",
    ],
)
@pytest.mark.parametrize("what", ["curve", "bench", "log"])
def test_a_file_that_is_no_table_is_not_repeated(what: str, text: str, folder: Path, rovid: Rovid) -> None:  # noqa: F811
    secret = folder.parent / "shadow"
    secret.write_text(text)
    if what == "curve":
        change('"curve.csv"', f'"{secret}"')(folder)
    if what == "log":
        (folder / "hold_0.csv").write_text(text)
    done = rovid("fit-thruster", secret) if what == "bench" else rovid("fit-drag", folder / "hold_0.csv")
    assert done.code == 2
    assert "no table of numbers" in done.err
    assert not any(word in done.err + done.out for word in ("salt", "BEGIN", "TOKEN"))


def test_commands_take_hostile_files_thrusters_and_vehicles(folder: Path, rovid: Rovid) -> None:  # noqa: F811
    path = folder / "rovid.toml"
    name = r"\u001b[31m[red]\u0000=1</script>\u202e"
    path.write_text(path.read_text().replace('"v"', f'"{name}"').replace('"fore"', f'"{name}"'))
    (folder / "hold_0.csv").rename(folder / "hold_\x1b[31m[red]\n.csv")
    (folder / "hold_1.csv").rename(folder / os.fsdecode(b"hold_\xff.csv"))
    outputs = []
    for command in (["check", folder], ["fit-drag", folder], ["report", "--no-control", "--no-diagnosis"]):
        for json_too in ([], ["--json"]):
            done = rovid(*command, *json_too)
            assert done.code == 0, done.err
            outputs.append(done.out + done.err)
            if json_too:
                json.loads(done.out.encode())
    page = Path("report/index.html").read_text(encoding="utf-8")
    for text in (*outputs, page):
        assert not STEERING.search(text)
    assert page.count("</script>") <= 2
    assert r"hold_\x1b[31m[red]\n.csv" in outputs[0]
    for svg in Path("report/plots").glob("*.svg"):
        ET.parse(svg)
    log = folder / "hold_\x1b[31m[red]\n.csv"
    mapping = rovid("convert", log, "-o", "new.csv")
    assert mapping.code == 0
    assert tomllib.loads(mapping.out)["thrusters"][0]["name"] == tomllib.loads(f'a = "{name}"')["a"]
    assert not STEERING.search(mapping.out + mapping.err)


def test_an_error_on_a_terminal_is_visible(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    err = io.StringIO()
    monkeypatch.setattr(sys, "argv", ["rovid", "check", str(tmp_path / "\x1b[31mgone")])
    monkeypatch.setattr(sys, "stderr", err)
    with pytest.raises(SystemExit):
        cli.main()
    assert "\x1b" not in err.getvalue()
    assert r"\x1b[31mgone" in err.getvalue()


def test_a_name_too_long_for_a_file_is_no_file(rovid: Rovid) -> None:
    for command in (["check", "n" * 300], ["init", "n" * 300]):
        assert_one_message(rovid(*command), "cannot be read (File name too long)")
    assert_one_message(rovid("simulate", "-p", "n" * 300), "there is no such")
