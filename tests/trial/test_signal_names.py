"""The words of a name."""

from __future__ import annotations

import pytest

from rovid.trial.axis import name_words


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("/phins/heading.data", {"phins", "heading", "data"}),
        ("yawRate_dps", {"yaw", "rate", "dps"}),
        ("RCOU.C1", {"rcou", "c", "1"}),
        ("IMUTemp", {"imu", "temp"}),
        ("Höhe über Grund", {"höhe", "über", "grund"}),
        ("___", set()),
    ],
)
def test_words_end_where_a_reader_sees_them_end(source: str, found: set[str]) -> None:
    assert name_words(source) == found
