"""Each threshold states its unit, decision, origin and sensitivity."""

from __future__ import annotations

import ast
import inspect
from dataclasses import fields

import pytest

from rovid.diagnose import thresholds
from rovid.diagnose.thresholds import THRESHOLDS, Thresholds


def texts() -> dict[str, str]:
    """Name of each field and the text below it."""
    (record,) = [node for node in ast.parse(inspect.getsource(thresholds)).body if isinstance(node, ast.ClassDef)]
    found = {}
    for node, below in zip(record.body, record.body[1:], strict=False):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            assert isinstance(below, ast.Expr)
            assert isinstance(below.value, ast.Constant)
            found[node.target.id] = " ".join(str(below.value.value).split())
    return found


@pytest.mark.parametrize("name", [field.name for field in fields(Thresholds)])
def test_a_threshold_states_its_unit_origin_and_sensitivity(name: str) -> None:
    text = texts()[name]
    assert ("Set: " in text and "alved" in text) or text.startswith(("As ", "The same")), text


def test_probabilities_are_ordered() -> None:
    assert 0.0 < THRESHOLDS.possible < THRESHOLDS.likely < THRESHOLDS.established < THRESHOLDS.max_probability < 1.0
