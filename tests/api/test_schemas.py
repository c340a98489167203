"""JSON Schemas of the documents; `tests.conftest.Done` checks each document that a test reads against its schema."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import rovid
from tests.conftest import require_schema

PACKAGE = Path(rovid.__file__).parent
SCHEMAS = sorted((PACKAGE / "schemas").glob("*.json"))
# Not printed with --json: lines of a file that rovid alone reads.
PRIVATE = {"rovid-history/1"}


def test_each_document_has_a_schema() -> None:
    sources = "".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    named = set(re.findall(r'"(rovid-[a-z-]+/1)"', sources))
    assert len(named) > 15
    assert named - PRIVATE <= {re.sub(r"-1$", "/1", path.stem) for path in SCHEMAS}


@pytest.mark.parametrize("path", SCHEMAS, ids=lambda path: path.stem)
def test_a_schema_is_valid_and_its_required_keys_are_described(path: Path) -> None:
    schema = json.loads(path.read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    assert set(schema["required"]) <= set(schema["properties"])
    name = schema["properties"]["schema"]["const"]
    assert f"{name.replace('/', '-')}.json" == path.name
    assert schema["title"].startswith(f"{name}: ")


def test_wrong_documents_are_refused() -> None:
    good = {"schema": "rovid-open/1", "address": "http://localhost", "folder": "/logs", "added": 1}
    require_schema(good)
    with pytest.raises(AssertionError, match="'folder' is a required property"):
        require_schema({key: value for key, value in good.items() if key != "folder"})
    fit: dict[str, Any] = {
        "parameters": {"inertia": {"value": "5057", "unit": "kg m^2"}},
        "effects": [],
        "log_likelihood": None,
    }
    fit |= {"samples": 10, "method": "", "not_identifiable": [], "guessed": [], "faults": [], "warnings": []}
    with pytest.raises(AssertionError, match=r"rovid-fit/1\.parameters\.inertia\.value"):
        require_schema({"schema": "rovid-fit/1", **fit})
