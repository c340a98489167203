"""Text of anybody's in every format's own quotes, and names that are identifiers."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import tomllib
import xml.etree.ElementTree as ET

import pytest
import yaml

from rovid.core.errors import escape_invisible
from rovid.core.formatting import csv_line, field_names, identifiers, to_json, toml_text, xml_attribute, xml_comment
from tests.hostile import NAMES, STEERING


@pytest.mark.parametrize("name", NAMES)
def test_each_format_gives_a_name_back_or_shows_it(name: str) -> None:
    quoted = toml_text(name)
    assert tomllib.loads(f"a = {quoted}")["a"] == yaml.safe_load(quoted) == name
    assert json.loads(to_json({name: [name]})) == {name: [name]}
    assert not STEERING.search(quoted + to_json({name: name}))
    element = ET.fromstring(f"<!--{xml_comment(name)} --><a b={xml_attribute(name)}/>")
    assert (element.get("b") or "").replace("$ ", "$") == escape_invisible(name)
    [cells] = csv.reader(io.StringIO(csv_line(["time_s", name])))
    assert cells[0] == "time_s"
    assert cells[1].replace("'", "") == escape_invisible(name).replace("'", "")
    for part in re.split("[;,]", cells[1]):
        assert part[:1] not in set("=+-@\t\r"), part


def test_a_name_of_bytes_that_are_no_text_is_written_as_an_escape() -> None:
    name = os.fsdecode(b"hold_\xff.csv")
    assert json.loads(to_json({name: name})) == {"hold_\\udcff.csv": "hold_\\udcff.csv"}
    to_json({name: name}).encode()
    assert tomllib.loads(f"a = {toml_text(name)}")["a"] == "hold_\\udcff.csv"


def test_identifiers_are_identifiers_and_no_two_alike() -> None:
    for made in (identifiers(NAMES, taken=("base",)), field_names(NAMES, taken=("base",))):
        assert len(set(made)) == len(NAMES)
        assert "base" not in made
        assert max(map(len, made)) <= 63
    assert all(name.isidentifier() and name.isascii() for name in identifiers(NAMES))
    # What is an identifier stays one, whoever else would come to it.
    assert identifiers(["a b", "a_b", "a?b", "a_b_2"]) == ["a_b", "a_b_3", "a_b_4", "a_b_2"]


def test_many_names_alike_take_no_longer_each_than_few() -> None:
    # Were each compared with all that came before, this would take minutes.
    made = field_names(["a"] * 50_000 + ["a_3"], taken=("a_2",))
    assert made[:3] == ["a", "a_4", "a_5"]
    assert made[-1] == "a_3"
    assert len(set(made)) == len(made)


def test_a_long_name_is_cut_and_still_its_own() -> None:
    long = "x" * 70
    cut, other, third = identifiers([long, long + "y", "x" * 61 + "_2"])
    assert (cut, other) == ("x" * 63, "x" * 61 + "_3")
    assert third == "x" * 61 + "_2"
