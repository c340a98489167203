"""docs/calibration.md carries the digest of the estimator's code."""

from __future__ import annotations

import pytest

from benchmarks.estimator_digest import CHANGED, LINE, PAGE, digest, digest_of_code


def test_the_page_on_calibration_speaks_of_this_code() -> None:
    (said,) = LINE.finditer(PAGE.read_text(encoding="utf-8"))
    assert said["digest"] == digest_of_code(), CHANGED


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ('"""Other."""\nimport math\n\n\ndef f(x: int) -> int:\n    """Twice."""\n    return 2 * x  # twice\n', True),
        ("def f(x):\n    return 2 * x", True),
        ("def f(x):\n    return 3 * x", False),
    ],
)
def test_only_what_computes_counts(text: str, same: bool) -> None:
    assert (digest([text]) == digest(["def f(x):\n    return 2 * x"])) is same
