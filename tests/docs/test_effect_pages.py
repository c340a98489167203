"""The pages of the effects agree with the catalogue."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from docs import make_effects
from docs.make_effects import FOLDER, INDEX, NOTES, forms_of, notes, pages, runs_with
from rovid.core.errors import ConfigError
from rovid.effects import CATALOGUE, Effect
from tests.conftest import ROOT

LARGEST_PICTURE = 40_000  # bytes


def written(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def links(text: str) -> list[str]:
    return re.findall(r"\]\(([^)#]+)", text)


@pytest.fixture(scope="module")
def made() -> dict[str, str]:
    return pages()


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.id)
class TestEachPage:
    def test_gives_the_equation_and_the_parameters_of_every_form(self, effect: Effect) -> None:
        text = written(f"{effect.id}.md")
        for form in forms_of(effect):
            assert f"**`{form.key}`**" in text
            assert f"```text\n{form.equation}\n```" in text
            for parameter in form.parameters:
                assert f"| {parameter.name} |" in text

    def test_links_to_every_rival(self, effect: Effect) -> None:
        text = written(f"{effect.id}.md")
        assert {f"{rival}.md" for rival in effect.rivals} <= set(links(text))

    def test_links_are_valid(self, effect: Effect) -> None:
        assert [name for name in links(written(f"{effect.id}.md")) if not (FOLDER / name).is_file()] == []

    def test_has_a_picture_of_moderate_size(self, effect: Effect) -> None:
        picture = FOLDER / f"{effect.id}.png"
        assert f"]({picture.name})" in written(f"{effect.id}.md")
        assert picture.read_bytes()[:4] == b"\x89PNG"
        assert picture.stat().st_size < LARGEST_PICTURE

    def test_is_up_to_date(self, effect: Effect, made: dict[str, str]) -> None:
        assert written(f"{effect.id}.md") == made[f"{effect.id}.md"], "run python docs/make_effects.py"

    def test_picture_shows_something(self, effect: Effect) -> None:
        step, sine = runs_with(effect, notes()[effect.id])
        for course in (step, sine):
            assert np.isfinite(course.rate).all()
            assert np.max(np.abs(course.rate - course.plain)) > 0.04 * np.max(np.abs(course.plain))


@pytest.mark.parametrize("effect", make_effects.planar_effects(), ids=lambda effect: effect.id)
def test_planar_page_is_up_to_date(effect: Effect, made: dict[str, str]) -> None:
    text = written(f"{effect.id}.md")
    assert text == made[f"{effect.id}.md"], "run python docs/make_effects.py"
    assert [name for name in links(text) if not (FOLDER / name).is_file()] == []


def test_index_is_up_to_date(made: dict[str, str]) -> None:
    assert written(INDEX) == made[INDEX], "run python docs/make_effects.py"


def test_index_links_to_every_page() -> None:
    assert {f"{effect.id}.md" for effect in CATALOGUE} <= set(links(written(INDEX)))
    assert [name for name in links(written(INDEX)) if not (FOLDER / name).is_file()] == []


def test_every_page_and_picture_has_its_effect(made: dict[str, str]) -> None:
    known = {effect.id for effect in CATALOGUE}
    assert {path.name for path in FOLDER.glob("*.md")} == set(made)
    assert {path.stem for path in FOLDER.glob("*.png")} == known
    assert set(notes()) == known


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[tank_seiche]", "[tank_seich]", r"has no entry \[tank_seiche\] with the keys text, sizes, values, hold,"),
        ("[tank_seiche]", "[another]\n[tank_seiche]", r"\[another\] is not the id of an effect\. There are: "),
        ("hold = ", "held = ", r"\[thruster_deadband\] has no hold\. "),
        ("hold = ", "volt = 2.0\nhold = ", r"\[thruster_deadband\] has volt\. Nearest: 'volts'"),
        ("{ deadband =", "{ width =", r"\[thruster_deadband\]: values has width; the parameters are deadband\."),
        ('against = "command"', 'against = "rates"', r"\[thruster_deadband\]: against is 'rates'\. Nearest: 'rate'"),
    ],
)
def test_errors_in_the_notes_give_one_message(
    old: str, new: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / NOTES.name).write_text(NOTES.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    monkeypatch.setattr(make_effects, "NOTES", tmp_path / NOTES.name)
    with pytest.raises(ConfigError, match=f"^notes.toml: {message}") as refused:
        notes()
    assert "\n" not in str(refused.value)


def test_readme_links_to_the_pages() -> None:
    target = Path("docs/effects") / INDEX
    assert str(target) in links((ROOT / "README.md").read_text(encoding="utf-8"))
