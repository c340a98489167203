"""Which files make one trial."""

from __future__ import annotations

import pytest

from rovid.campaign.joining import Join, parts_among


@pytest.mark.parametrize(
    ("names", "parts"),
    [
        (["run1_ins.csv", "run1_thr.csv", "run2_ins.csv", "run2_thr.csv"], ("ins", "thr")),
        (["run1/ins.csv", "run1/thr.csv", "run2/ins.csv", "run2/thr.csv"], ("ins", "thr")),
        (["imu-07.csv", "motors-07.csv", "imu-08.csv", "motors-08.csv", "thrust_curve.csv"], ("imu", "motors")),
        (["hold_1.csv", "hold_2.csv"], ()),
        (["a.csv"], ()),
    ],
)
def test_parts_are_words_in_which_files_differ(names: list[str], parts: tuple[str, ...]) -> None:
    assert parts_among(names) == parts


def test_files_of_a_trial_have_all_else_in_common() -> None:
    join = Join(parts=("ins", "thr"))
    names = ["run2_thr.csv", "run1_thr.csv", "run1_ins.csv", "run1_gps.csv"]
    assert join.of_trial("run1_thr.csv", names) == ["run1_ins.csv", "run1_thr.csv"]
    assert not join.part("run1_gps.csv")
