"""Choices change rovid.toml and the result of `rovid check`; foreign files are not replaced."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path
from typing import Any

import pytest

from rovid.app.access import RootFolder
from rovid.app.api import Api
from rovid.core.errors import RovidError
from rovid.trial.config import load_config, load_planar_config
from tests.app.conftest import DAY, logs_into, riddle
from tests.conftest import SAMPLES, run_rovid
from tests.preflight.test_drive_guess import boat


def desk(top: Path) -> Api:
    return Api(root=RootFolder(folder=top))


def chosen(folder: str = "day", **more: Any) -> dict[str, Any]:
    signals = {"csv": {"heading": {"source": "heading_deg", "unit": "deg", "sign": 1}}}
    commands = {"csv": [{"source": f"{name}_V", "name": name, "arm": 0.43} for name in ("fore", "aft")]}
    return {"logs": [folder], "signals": signals, "commands": commands} | more


def test_the_guess_equals_the_file_of_init(tmp_path: Path) -> None:
    folder = logs_into(tmp_path / "day")
    draft = desk(tmp_path).draft({"logs": ["day"]})
    assert run_rovid("init", folder).code == 0
    assert (folder / "rovid.toml").read_text() == draft["text"]
    assert draft["survey"]["open"] == []


def test_choices_appear_in_the_file(tmp_path: Path) -> None:
    logs_into(tmp_path / "day")
    stretch = {"log": "hold_03.csv", "from": 3.5, "to": 20.0, "reason": "hand on the vehicle"}
    document = chosen(name="mine", size={"mass": 2604.0}, leave_out=[stretch])
    one = desk(tmp_path)
    checked = one.check(document)
    assert checked["verdict"] in {"go", "care"}
    assert any("hand on the vehicle" in note for note in checked["notes"])
    assert not checked["caution"]
    one.save(document)
    config = load_config(tmp_path / "day" / "rovid.toml")
    assert [(thruster.name, thruster.arm) for thruster in config.vehicle.thrusters] == [("fore", 0.43), ("aft", 0.43)]
    assert (config.vehicle.name, config.vehicle.mass) == ("mine", 2604.0)
    assert [(each.log, each.begin, each.end) for each in config.exclusions] == [("hold_03.csv", 3.5, 20.0)]
    assert not config.vehicle.assumptions
    # The command line gives the same result.
    assert run_rovid("check", tmp_path / "day", "--json").document == checked["document"]


def test_the_unit_of_the_time_is_a_choice(tmp_path: Path) -> None:
    folder = logs_into(tmp_path / "day", "hold_03.csv")
    text = (folder / "hold_03.csv").read_text().replace("time_s", "tick", 1)
    (folder / "hold_03.csv").write_text(text)
    one = desk(tmp_path)
    assert 'time = { csv = "tick" }' in one.draft(chosen())["text"]
    assert 'time = { csv = "tick", unit = "ms" }' in one.draft(chosen(time_unit="ms"))["text"]
    spans = [one.columns("day/hold_03.csv", [], -1e9, 1e9, 10, time_unit=unit)["end"] for unit in ("auto", "ms")]
    assert spans[1] == pytest.approx(1e-3 * spans[0])
    with pytest.raises(RovidError, match="invalid choice"):
        one.draft(chosen(time_unit="h"))


def test_a_rudder_is_part_of_the_answer(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    boat(tmp_path / "day")
    one = desk(tmp_path)
    [rudder] = one.draft({"logs": ["day"]})["survey"]["rudders"]["csv"]
    assert (rudder["name"], rudder["source"], rudder["unit"]) == ("rudder", "helm_deg", "deg")
    assert "turns the heading down" in rudder["why"]
    assert (rudder["size"], rudder["value"], rudder["given"]) == ("coefficient", None, False)
    known = one.draft({"logs": ["day"], "rudders": {"rudder": 12.5}})
    # `plan` and `export` refuse a rudder.
    assert all(each["line"].split()[1] in {"init", "check", "diagnose", "report"} for each in known["commands"])
    assert "coefficient = 12.5    # N m s^2/(m^2 rad)" in known["text"]
    assert "coefficient of rudder" not in known["survey"]["guessed"]
    # Another role of its column takes it out.
    signals = {"heading": {"source": "hdg_deg", "unit": "deg"}, "helm": {"source": "helm_deg"}}
    document = one.draft({"logs": ["day"], "signals": {"csv": signals}, "commands": {}})
    assert document["survey"]["rudders"] == {"csv": []}


def test_surge_sway_and_yaw_can_be_taken_together(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    for name in ("run_01.csv", "curve_main.csv"):
        shutil.copy(SAMPLES / "planar_rov" / name, tmp_path / "day")
    one = desk(tmp_path)
    document = {"logs": ["day"], "axes": "planar"}
    draft = one.draft(document)
    assert draft["planar"] == ["surge_velocity", "sway_velocity"]
    assert all("--axes planar" in command["line"] for command in draft["commands"])
    assert draft["commands"][-1]["line"].startswith("rovid export gz-sim")
    assert one.check(document)["verdict"] in {"go", "care"}
    # A placed thruster has its shares along surge and sway from its direction.
    guessed = draft["survey"]["commands"]["csv"]
    commands = [{"source": each["source"], "name": each["name"], "arm": 0.4, "angle": 30.0} for each in guessed]
    placed = document | {"commands": {"csv": commands}}
    one.save(placed)
    vehicle = load_planar_config(tmp_path / "day" / "rovid.toml").vehicle
    assert [(round(each.surge_share, 3), round(each.sway_share, 3)) for each in vehicle.thrusters] == [
        (0.866, 0.5)
    ] * len(guessed)
    assert "surge and sway of lateral and main" in one.check(document)["tasks"][0]
    assert not any("surge" in text or "sway" in text for text in one.check(placed)["tasks"])


def test_a_rovid_toml_of_the_users_own_is_shown(tmp_path: Path) -> None:
    """Its arms and units, for the formats that there are; whatever its form."""
    folder = logs_into(tmp_path / "day")
    shutil.copy(DAY / "rovid.toml", folder)
    choice = desk(tmp_path).look(["day"])["existing"]["choice"]
    assert choice["signals"]["csv"]["heading"] == {"source": "heading_deg", "unit": "deg", "sign": 1}
    assert [(each["name"], each["arm"]) for each in choice["commands"]["csv"]] == [("fore", 0.43), ("aft", 0.43)]
    assert set(choice["signals"]) == {"csv"}
    for text in ("signals = 3\nthrusters = [1, {command = 2}]\nvehicle = []", "[", ""):
        (folder / "rovid.toml").write_text(text)
        assert not desk(tmp_path).look(["day"])["existing"]["choice"].get("commands")


def test_empty_folders_and_those_without_logs_are_told(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    with pytest.raises(RovidError, match=r"day: holds no logs: .* Put the logs into this folder"):
        desk(tmp_path).look(["day"])
    (tmp_path / "day" / "notes.txt").write_text("x")
    with pytest.raises(RovidError, match=r"day: holds no logs: .* It holds 1 \.txt"):
        desk(tmp_path).look(["day"])


def test_unrecognised_columns_can_be_chosen(tmp_path: Path) -> None:
    riddle(tmp_path / "day")
    one = desk(tmp_path)
    assert one.draft({"logs": ["day"]})["survey"]["open"]
    signals = {"csv": {"heading": {"source": "a", "unit": "deg", "sign": 1}}}
    commands = {"csv": [{"source": name, "name": name, "arm": None} for name in "bc"]}
    document = {"logs": ["day"], "signals": signals, "commands": commands}
    draft = one.draft(document)
    assert draft["survey"]["open"] == []
    assert {each["turns"] for each in draft["survey"]["commands"]["csv"]} == {1}
    # The shown command writes the same file.
    line = next(each["line"] for each in draft["commands"] if " init " in each["line"])
    assert line == "rovid init day --heading a --command b,c"
    assert run_rovid(*shlex.split(line)[1:2], tmp_path / "day", *shlex.split(line)[3:]).code == 0
    written = load_config(tmp_path / "day" / "rovid.toml")
    one_by_hand = tmp_path / "other.toml"
    one_by_hand.write_text(draft["text"].replace("thrust_guess.csv", "day/thrust_guess.csv"))
    assert load_config(one_by_hand).signals == written.signals
    assert load_config(one_by_hand).commands == written.commands


def test_a_wrong_column_is_reported(tmp_path: Path) -> None:
    logs_into(tmp_path / "day")
    wrong = chosen()
    wrong["signals"]["csv"]["heading"]["source"] = "supply_V"
    checked = desk(tmp_path).check(wrong)
    assert checked["verdict"] == "no_go"
    away = chosen()
    away["signals"]["csv"]["heading"]["source"] = "heading_degs"
    away["commands"]["csv"][0]["source"] = "fore_W"
    assert desk(tmp_path).draft(away)["survey"]["open"] == []
    (task,) = desk(tmp_path).check(away)["tasks"]
    assert "has no column 'heading_degs', which rovid.toml maps to heading. Nearest: 'heading_deg'." in task
    rad = chosen()
    rad["signals"]["csv"]["heading"]["unit"] = "furlong"
    checked = desk(tmp_path).check(rad)
    assert checked["verdict"] == "no_go"
    assert "'furlong'" in checked["tasks"][0]
    assert str(tmp_path / "day" / "rovid.toml") in checked["tasks"][0]


def test_a_truncated_log_is_named(tmp_path: Path) -> None:
    folder = logs_into(tmp_path / "day")
    (folder / "cut.csv").write_bytes((DAY / "hold_01.csv").read_bytes()[:40])
    (folder / "cut.mcap").write_bytes((DAY / "coast_01.mcap").read_bytes()[:200])
    one = desk(tmp_path)
    assert any("cut.mcap" in warning for warning in one.draft({"logs": ["day"]})["survey"]["warnings"])
    checked = one.check(chosen())
    assert checked["verdict"] == "no_go"
    assert "cut.csv" in checked["tasks"][0]
    with pytest.raises(RovidError, match=r"cut\.mcap"):
        one.columns("day/cut.mcap", [], 0.0, 1.0, 100)


def test_its_own_file_is_replaced_and_read_back(tmp_path: Path) -> None:
    logs_into(tmp_path / "day")
    desk(tmp_path).save(chosen())
    again = desk(tmp_path)
    assert again.look(["day"])["chosen"]["commands"]["csv"][0]["arm"] == 0.43
    again.save(chosen(name="renamed"))
    assert load_config(tmp_path / "day" / "rovid.toml").vehicle.name == "renamed"


@pytest.mark.parametrize("whose", ["written by hand", "changed by hand", "written by rovid init"])
def test_a_foreign_rovid_toml_is_never_replaced(tmp_path: Path, whose: str) -> None:
    folder = logs_into(tmp_path / "day")
    path = folder / "rovid.toml"
    one = desk(tmp_path)
    if whose == "written by hand":
        path.write_text((DAY / "rovid.toml").read_text())
    elif whose == "changed by hand":
        one.save(chosen())
        path.write_text(path.read_text().replace("0.43", "0.44"))
    else:
        assert run_rovid("init", folder).code == 0
    before = path.read_text()
    assert one.look(["day"])["chosen"] is None
    with pytest.raises(RovidError, match="already exists"):
        one.save(chosen(name="another"))
    assert path.read_text() == before
    # The check uses that file.
    assert one.check(chosen(name="another"))["document"] == run_rovid("check", folder, "--json").document


def test_a_changed_curve_is_never_replaced(tmp_path: Path) -> None:
    folder = riddle(tmp_path / "day")
    one = desk(tmp_path)
    commands = {"csv": [{"source": "b", "name": "b", "arm": 1.0}]}
    signals = {"csv": {"heading": {"source": "a", "unit": "deg", "sign": 1}}}
    document = {"logs": ["day"], "signals": signals, "commands": commands}
    one.save(document)
    curve = folder / "thrust_guess.csv"
    curve.write_text('"command",thrust_N\n-9,-50\n0,0\n9,50\n')
    before = [path.read_bytes() for path in (curve, folder / "rovid.toml")]
    with pytest.raises(RovidError, match=r"thrust_guess\.csv: exists already and was changed .* rename it"):
        one.save(document | {"name": "another"})
    assert [path.read_bytes() for path in (curve, folder / "rovid.toml")] == before


def test_a_curve_that_is_a_link_out_is_not_read(tmp_path: Path) -> None:
    folder = logs_into(tmp_path / "top" / "day")
    (folder / "thrust_curve.csv").rename(tmp_path / "curve.csv")
    (folder / "thrust_curve.csv").symlink_to(tmp_path / "curve.csv")
    with pytest.raises(RovidError, match="a link that leads out of"):
        desk(tmp_path / "top").draft({"logs": ["day/hold_03.csv"]})


def test_a_rovid_toml_in_the_parent_folder_is_used_and_kept(tmp_path: Path) -> None:
    logs_into(tmp_path / "day" / "first")
    one = desk(tmp_path)
    one.save(chosen())
    below = chosen("day/first")
    assert one.look(["day/first"])["chosen"] is None
    assert one.look(["day/first"])["existing"]["file"] == "day/rovid.toml"
    below["commands"] = {"csv": []}
    assert one.check(below)["verdict"] != "no_go"


def test_a_curve_outside_is_not_read(tmp_path: Path) -> None:
    folder = logs_into(tmp_path / "top" / "day")
    secret = tmp_path / "secret.csv"
    secret.write_text("root:x:0:0\n")
    toml = (DAY / "rovid.toml").read_text()
    for curve in ("../../secret.csv", str(secret), "link.csv"):
        (folder / "link.csv").unlink(missing_ok=True)
        (folder / "link.csv").symlink_to(secret)
        (folder / "rovid.toml").write_text(toml.replace('"thrust_curve.csv"', f'"{curve}"'))
        with pytest.raises(RovidError) as refused:
            desk(tmp_path / "top").check(chosen())
        assert "root:x" not in str(refused.value)


def test_many_logs_and_columns_are_read(tmp_path: Path) -> None:
    folder = logs_into(tmp_path / "day")
    head, *rows = (DAY / "hold_01.csv").read_text().splitlines()
    more = [f"aux_{k}" for k in range(54)]
    text = "\n".join([",".join([head, *more]), *(",".join([row, *["0.5"] * len(more)]) for row in rows[:400])])
    for number in range(40):
        (folder / f"run_{number:02}.csv").write_text(f"{text}\n{rows[400 + number]}{',0' * len(more)}\n")
    one = desk(tmp_path)
    assert len(one.look(["day"])["logs"]) == 42
    assert len(one.columns("day/run_07.csv", ["heading_deg"], -1e9, 1e9, 300)["columns"]) == 60
    assert len(one.check(chosen())["document"]["logs"]) == 42


def test_files_of_single_sensors_are_joined_as_on_the_command_line(tmp_path: Path) -> None:
    folder = logs_into(tmp_path / "day")
    for log in ("hold_03", "sine_40s_a"):
        head, *rows = [line.split(",") for line in (folder / f"{log}.csv").read_text().splitlines()]
        (folder / f"{log}.csv").unlink()
        for part, names in (("ins", ("time_s", "heading_deg")), ("thr", ("time_s", "fore_V", "aft_V"))):
            at = [head.index(name) for name in names]
            text = "\n".join(",".join(row[k] for k in at) for row in (head, *rows))
            (folder / f"{log}_{part}.csv").write_text(f"{text}\n")
    one = desk(tmp_path)
    assert one.draft({"logs": ["day"]})["survey"]["joined"] == ["ins", "thr"]
    checked = one.check(chosen())
    assert len(checked["document"]["logs"]) == 2
    one.save(chosen())
    assert run_rovid("check", folder, "--json").document == checked["document"]


def test_one_log_alone_is_enough(tmp_path: Path) -> None:
    logs_into(tmp_path / "day")
    draft = desk(tmp_path).draft({"logs": ["day/hold_03.csv"]})
    assert draft["file"] == "day/rovid.toml"
    named = [each["line"].split()[1] for each in draft["commands"]]
    assert named == ["init", "check", "diagnose", "report", "plan", "export"]


def test_a_folder_named_like_an_option_is_not_an_option(tmp_path: Path) -> None:
    logs_into(tmp_path / "--force")
    lines = [each["line"] for each in desk(tmp_path).draft({"logs": ["--force"]})["commands"]]
    assert all(" ./--force" in line and " --force" not in line for line in lines)
