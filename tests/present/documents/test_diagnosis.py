"""A diagnosis as JSON."""

from __future__ import annotations

import json

import pytest

from rovid.core.formatting import to_json
from rovid.diagnose.result import Diagnosis
from rovid.present.documents.diagnosis import diagnosis_document
from rovid.store.study import Study, open_study
from tests.conftest import SAMPLES


@pytest.fixture(scope="module")
def tables() -> Study:
    return open_study([SAMPLES / "rosub_paper"])


def test_too_little_data_says_what_is_missing_and_what_to_run(tables: Study) -> None:
    document = diagnosis_document(Diagnosis(verdict="too_little_data", missing="Sines."), tables)
    assert (document["schema"], document["verdict"]) == ("rovid-diagnosis/1", "too_little_data")
    assert document["missing"] == "Sines."
    assert document["base"] is None
    assert document["extended"] is None
    assert document["held_out_gain"] is None
    assert document["removed_share"] == {"value": None, "upper_bound": False}
    assert "sines" in document["next_experiment"]["run"]
    assert "rate_scale" in document["not_identifiable"]
    assert json.loads(to_json(document))["findings"] == []


@pytest.mark.slow
def test_what_tables_say_by_themselves_is_a_part_of_its_own(tables: Study) -> None:
    diagnosis = tables.diagnosis()
    document, amplitudes = diagnosis_document(diagnosis, tables), diagnosis.from_tables
    assert amplitudes is not None
    assert len(document["tables"]["predictions"]) == len(amplitudes.predictions)
    assert document["tables"]["plain_model_explains"] is amplitudes.without_effect.explains
    named = [cause["effect"] for cause in document["tables"]["would_explain"]]
    assert named == [cause.model.effects[0].id for cause in amplitudes.causes]
    assert not {*named} & {*document["tables"]["would_not_explain"]}
