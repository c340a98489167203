"""The page's form is validated, and choices are read back from an unchanged rovid.toml."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rovid.app.form_state import parse_form, read_form_data, sha256_digest, with_form_data
from rovid.core.errors import ConfigError

WHOLE: dict[str, Any] = {
    "logs": ["day"],
    "vehicle": "otter",
    "name": "mine",
    "size": {"mass": 55.0},
    "signals": {"csv": {"heading": {"source": "a", "unit": "deg", "sign": -1}}},
    "commands": {"csv": [{"source": "b", "name": "port", "arm": 0.3}, {"source": "c", "name": "stbd", "arm": None}]},
    "leave_out": [{"log": "a.csv", "from": 3.0, "to": None, "reason": "tether"}],
}


def test_a_form_is_parsed() -> None:
    hand = parse_form(WHOLE).overrides
    assert hand.signals is not None
    heading = hand.signals["csv"]["heading"]
    assert (heading.source, heading.unit, heading.sign) == ("a", "deg", -1)
    assert hand.arms == {"b": 0.3}
    assert hand.commands == frozenset({"b", "c"})
    assert hand.names == {"b": "port", "c": "stbd"}
    assert [str(one) for one in hand.exclusions] == ["all from 3 s on"]
    assert math.isinf(hand.exclusions[0].end)
    assert hand.size == {"mass": 55.0}


@pytest.mark.parametrize(
    "wrong",
    [
        None,
        [],
        {},
        {"logs": 3},
        WHOLE | {"size": {"mass": -1}},
        WHOLE | {"size": {"mass": "heavy"}},
        WHOLE | {"vehicle": "/etc/passwd.toml"},
        WHOLE | {"vehicle": 7},
        WHOLE | {"signals": {"csv": {"heading": "a"}}},
        WHOLE | {"commands": {"csv": [{"source": "b", "arm": math.nan}]}},
        WHOLE | {"commands": [1]},
        WHOLE | {"leave_out": [{"log": "a"}, {"from": 3}]},
        WHOLE | {"name": "x" * 10_000},
        WHOLE | {"rudders": {"rudder": 0.0}},
    ],
)
def test_an_invalid_form_is_refused(wrong: object) -> None:
    with pytest.raises(ConfigError, match="the page sent"):
        parse_form(wrong)


def test_a_file_is_recognised_until_it_is_changed() -> None:
    choice = parse_form(WHOLE)
    text = with_form_data("[vehicle]\n", choice, {"thrust_guess.csv": b"1"})
    known = read_form_data(text)
    assert known is not None
    assert known[0] == {key: value for key, value in WHOLE.items() if key != "logs"}
    assert sha256_digest(b"1") == known[1]["thrust_guess.csv"]
    for other in (f"# mine\n{text}", text.replace("[vehicle]", "[vehicles]"), "[vehicle]\n", "", text[:-5]):
        assert read_form_data(other) is None
