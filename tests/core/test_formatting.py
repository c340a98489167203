"""Text of results and text from files."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
import tomllib
import xml.etree.ElementTree as ET

import pytest
import yaml
from rich.table import Table

from rovid.core.errors import escape_invisible
from rovid.core.formatting import (
    SafeConsole,
    csv_line,
    field_names,
    identifiers,
    labelled_text,
    plus_minus,
    round_to_error,
    significant,
    to_json,
    toml_text,
    xml_attribute,
    xml_comment,
)
from tests.hostile import NAMES, STEERING


def printed(thing: object) -> str:
    stream = io.StringIO()
    SafeConsole(file=stream, width=60, force_terminal=False).print(thing)
    return stream.getvalue().rstrip()


def test_nothing_is_taken_for_markup_or_for_a_picture() -> None:
    assert printed("[red]a[/red] :smile:") == "[red]a[/red] :smile:"


def test_what_is_not_seen_is_printed_as_an_escape() -> None:
    assert printed("a\x1b[31mb") == "a\\x1b[31mb"
    rows = Table("a\x07b")
    rows.add_row("c\x9bd")
    assert "a\\x07b" in printed(rows)
    assert "c\\x9bd" in printed(rows)


def test_a_lead_stands_before_its_text() -> None:
    assert printed(labelled_text("Next:", "a run\x1b")) == "Next: a run\\x1b"
    assert printed(labelled_text("Alone")) == "Alone"


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


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [
        (3610.38, 315.4, "3610 ± 320"),
        (103.138, 61.29, "103 ± 61"),
        (5056.93, 0.156, "5056.93 ± 0.16"),
        (0.1234567, 0.00456, "0.1235 ± 0.0046"),
        (123456.0, 45678.0, "123000 ± 46000"),
        (0.5, 0.0996, "0.50 ± 0.10"),
        (2.5, math.nan, "2.500"),
    ],
)
def test_values_are_rounded_to_their_uncertainty(value: float, error: float, expected: str) -> None:
    assert plus_minus(value, error) == expected


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [
        (-0.0312, 0.004, "-0.0312"),
        (-0.0312, 0.04, "-0.031"),
        (-0.0004, 0.2, "0.00"),
        (212.53, 0.9, "212.53"),
        (212.53, 45.0, "213"),
        (0.031, math.nan, "0.03100"),
    ],
)
def test_what_is_small_is_rounded_to_its_uncertainty_too(value: float, error: float, expected: str) -> None:
    assert round_to_error(value, error) == expected


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [
        (0.002, 2, "0.0020"),
        (0.0996, 2, "0.10"),
        (12.34, 2, "12"),
        (1234.0, 2, "1200"),
        (-0.03, 1, "-0.03"),
        (0.0, 3, "0"),
        (1.234e-9, 2, "1.2e-09"),
        (12345678.0, 3, "1.23e+07"),
        (math.inf, 3, "inf"),
    ],
)
def test_digits_that_count_are_all_there(value: float, digits: int, expected: str) -> None:
    assert significant(value, digits) == expected
