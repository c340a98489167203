"""The pages that `rovid help` brings: those of docs/, in a checkout and in a wheel."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path

import pytest

from rovid.core.errors import ConfigError
from rovid.effects import CATALOGUE
from rovid.present.terminal import topics
from tests.conftest import ROOT, Rovid

DOCS = ROOT / "docs"


def test_every_effect_has_a_page_and_all_have_titles() -> None:
    there = topics.topic_names()
    assert {effect.id for effect in CATALOGUE} <= set(there)
    assert len(set(there)) == len(there)
    assert all(re.fullmatch(r"[A-Z].{3,}", topics.topic_title(name)) for name in there)


@pytest.mark.parametrize("topic", topics.topic_names())
def test_a_page_cites_nothing_that_an_installed_rovid_lacks(topic: str) -> None:
    text = topics.topic_text(topic)
    assert not re.search(r"\]\([^)]*\.(md|png)|<!--|!\[|docs/", text)
    for named in re.findall(r"`rovid help ([a-z_-]+)`", text):
        assert named in topics.topic_names()
    if "sample_logs" in text:
        assert text.rstrip().endswith("The sample logs come with rovid's sources.")


def test_an_effect_is_told_as_its_page_tells_it() -> None:
    page = (DOCS / "effects" / "thruster_lag.md").read_text(encoding="utf-8")
    text = topics.topic_text("thruster_lag")
    for part in ("τ·dT'/dt + T' = T", "Work class: 0.1 to 0.3 s electric", "0.15 s about +45 %"):
        assert part in page
        assert part in text
    assert "Drawn with" not in text


@pytest.mark.parametrize(
    ("asked", "nearest"),
    [("lag", "thruster_lag"), ("gazebo", "export"), ("surge", "axes"), ("friction", "coulomb_resistance")],
)
def test_what_is_called_otherwise_is_found(asked: str, nearest: str) -> None:
    with pytest.raises(ConfigError, match=f"there is no page '{asked}'. Nearest: .*'{nearest}'"):
        topics.topic_text(asked)


@pytest.mark.parametrize(
    ("words", "heading"),
    [
        ("sign of a yaw arm", "Which sign does a yaw arm have?"),
        ("how long is a hold", "How long should a hold be?"),
        ("what is the noise floor", "What is the noise floor?"),
        ("units", "Which units may my logs have?"),
        ("confirmed likely possible", "What do confirmed, likely, possible and cannot tell mean?"),
        ("what does likely mean", "What do confirmed, likely, possible and cannot tell mean?"),
        ("ROS 1 bag", "ROS bags: `.bag` and `.db3`"),
        ("dataflash", "Logs: formats, conversion, recordings of simulations"),
        ("buoyancy gazebo", "In your own Gazebo world"),
        # Of the options first.
        ("overrule", "Further questions"),
        ("cutoff", "Rates"),
        ("bandwidth", "Control law"),
        # No passage holds all of these words.
        ("length of a hold", "How long should a hold be?"),
        ("why is my inertia too high", "Why is the inertia or the drag too high, or too low?"),
        ("how many runs do I need", "Which runs do I need, and how many?"),
        ("wrong column name", "Further questions"),
        ("thrust curve unknown", "Thrust curve"),
        ("does it work without internet", "Is anything sent over the network?"),
    ],
)
def test_words_of_a_question_find_the_passage(words: str, heading: str, rovid: Rovid) -> None:
    first = topics.find_passages(words)[0]
    assert first.heading == heading
    assert all(re.search(r"\w", one.text) for one in topics.find_passages(words))
    done = rovid("help", *words.split())
    assert done.code == 0
    assert f"rovid help {first.topic}: {heading}" in " ".join(done.out.split())


def test_a_wheel_brings_the_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rovid: Rovid) -> None:
    """Where the build puts them, they are found."""
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
    assert build["wheel"]["sources"] == {"docs": "rovid/pages"}
    for pattern in ("/docs/*.md", "/docs/effects/*.md", "/docs/faults/*.md"):
        assert pattern in build["wheel"]["include"]
        assert pattern in build["sdist"]["include"]
    here = topics.topic_text("logs")
    installed = tmp_path / "site-packages" / "rovid"
    shutil.copytree(DOCS, installed / "pages")
    monkeypatch.setattr(topics, "_PACKAGE", installed)
    assert topics.topic_text("logs") == here
    assert "Thruster lag" in rovid("help", "thruster_lag").out


@pytest.mark.parametrize(("word", "pages"), [("overrule", []), ("sentinel", ["sentinel_command"]), ("gyro", [])])
def test_pages_of_similar_names_are_offered_only_where_they_are_similar(
    word: str, pages: list[str], rovid: Rovid
) -> None:
    text = " ".join(rovid("help", word).out.split())
    named = "".join(f"Pages with similar names: {', '.join(map(repr, pages))}. " for _ in pages[:1])
    assert text.endswith(f"{named}`rovid help` lists them all." if pages else "`rovid help` lists the pages.")
    assert ("similar" in text) is bool(pages)
