"""Pages of the documentation on a terminal."""

from __future__ import annotations

import json

import pytest

from rovid.effects import CATALOGUE
from rovid.present.terminal.topics import TOPICS, topic_names
from tests.conftest import Rovid, slow


@pytest.mark.parametrize("width", [60, slow(80), slow(120)])
def test_every_page_fits(width: int, rovid: Rovid, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    for topic in (*TOPICS, "thruster_lag", "supply_sag"):
        done = rovid("help", topic)
        assert (done.code, done.err) == (0, "")
        assert max(map(len, done.out.splitlines())) <= width, topic


def test_the_list_has_all_and_their_titles(rovid: Rovid) -> None:
    text = rovid("help").out
    for name in (*TOPICS, *(effect.id for effect in CATALOGUE)):
        assert f"\n{name} " in text


def test_a_command_has_its_manual_and_its_page(rovid: Rovid) -> None:
    manual = rovid("plan", "--help").out.strip()
    both = rovid("help", "plan").out
    assert both.startswith(manual)
    assert "Ranking" in both.removeprefix(manual)
    assert rovid("help", "check").out.strip() == rovid("check", "--help").out.strip()


def test_json_has_one_document(rovid: Rovid) -> None:
    listed = rovid("help", "--json").document
    assert list(listed["topics"]) == topic_names()
    page = rovid("help", "logs", "--json").document
    assert (page["topic"], page["manual"]) == ("logs", None)
    assert page["text"].startswith("# Logs")
    assert "Usage: rovid check" in json.dumps(rovid("help", "check", "--json").document["manual"])


def test_a_page_that_is_not_there(rovid: Rovid) -> None:
    done = rovid("help", "thruster_lagg")
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("rovid: there is no page 'thruster_lagg'. Nearest: 'thruster_lag', ")
    assert done.err.endswith("`rovid help` lists them all.\n")
