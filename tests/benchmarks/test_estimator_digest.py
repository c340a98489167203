"""docs/calibration.md carries the digest of the estimator's code."""

from __future__ import annotations

import pytest

from benchmarks.estimator_digest import CHANGED, LINE, PAGE, digest, digest_of_code, line


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


def test_a_renewal_keeps_the_last_check_with_the_code_that_it_checked() -> None:
    check = "Checked by 20 campaigns, seed 2: 76 of 80 95 % intervals hold."
    code = digest_of_code()
    assert line(check, "") == f"Estimator's code: `{code}`. {check}"
    assert line("", f"Text.\n\nEstimator's code: `{code}`. {check}\n\nText.") == line(check, "")
    changed = line("", f"Estimator's code: `abc`. {check}\n")
    assert changed == f"Estimator's code: `{code}`. Earlier code, `abc`, was c{check[1:]}"
    assert line("", changed.replace(code, "def")) == changed
    none = "Estimator's code: `abc`. No campaigns have checked this code."
    assert line("", none) == none.replace("abc", code)
