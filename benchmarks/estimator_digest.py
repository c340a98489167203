"""Digest of the estimator's code, which docs/calibration.md carries: does the page still speak of this code?

``python -m benchmarks.estimator_digest --renew`` writes the digest of today into the page, ``--campaigns 20`` first
checks today's code on so many simulated campaigns and records how many of its 95 % intervals hold. Comments,
docstrings, annotations of functions, imports and layout do not count.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import re
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "calibration.md"
# What turns logs into estimates and their errors; effects have pages and tests of their own.
FILES = (
    "estimate/dataset.py", "estimate/estimate.py", "estimate/fisher_information.py", "estimate/fit_result.py",
    "estimate/innovation_likelihood.py", "estimate/levenberg_marquardt.py", "estimate/maximum_likelihood.py",
    "estimate/missing_torque.py", "estimate/multi_step.py", "estimate/nested_fits.py", "estimate/objective.py",
    "estimate/parametrization.py", "estimate/unknown_past.py", "model/filter_batch.py", "model/kernels/ekf3.py",
    "model/kernels/multi_step.py", "model/kernels/rk4.py", "model/ode.py",
)  # fmt: skip
LINE = re.compile(r"^Estimator's code: `(?P<digest>[0-9a-f]+)`\. ?(?P<check>.*(?:\n.+)*)$", re.MULTILINE)
SEED = 2  # of the campaigns of a check; the page's own have seed 1
CHANGED = (
    "The estimator's code changed since docs/calibration.md was written. If the numbers changed, run `python -m "
    "benchmarks.estimator_digest --renew --campaigns 20` (half an hour); if only the form of the code did, leave out "
    "--campaigns. Commit the page."
)


class _Bare(ast.NodeTransformer):
    """Leaves out what does not compute: docstrings, annotations, imports."""

    def visit(self, node: ast.AST) -> ast.AST | None:
        if isinstance(node, ast.Import | ast.ImportFrom):
            return None
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return None
        if isinstance(node, ast.arg):
            node.annotation = None
        if isinstance(node, ast.FunctionDef):
            node.returns = None
        return self.generic_visit(node)


def digest(texts: Iterable[str]) -> str:
    """First 16 digits of the SHA-256 of the bare syntax trees."""
    trees = [ast.dump(_Bare().generic_visit(ast.parse(text))) for text in texts]
    return hashlib.sha256("\n".join(trees).encode()).hexdigest()[:16]


def digest_of_code() -> str:
    """The digest of `FILES` as they are."""
    return digest((ROOT / "rovid" / name).read_text(encoding="utf-8") for name in FILES)


def line(checked: str, page: str) -> str:
    """What the page says of the code it stands for; without a new check the last one stays, with its code."""
    code = digest_of_code()
    if not checked and (before := LINE.search(page)):
        checked = before["check"]
        if before["digest"] != code:
            checked = checked.replace("Checked by", f"Earlier code, `{before['digest']}`, was checked by")
    return f"Estimator's code: `{code}`. {checked or 'No campaigns have checked this code.'}"


def check(campaigns: int) -> str:
    """Diagnose simulated campaigns with today's code; a sentence on its intervals."""
    from benchmarks.calibration import diagnosed
    from benchmarks.calibration_page import group_of, readings_of

    records = [one for one in diagnosed(SEED, range(campaigns), 2, 1200.0) if one["said"] is not None]
    sure = [one for one in records if group_of(one) != "cause not named"]
    readings = [abs(reading["deviation"]) <= 1.959964 for one in sure for reading in readings_of(one)]
    return f"Checked by {campaigns} campaigns, seed {SEED}: {sum(readings)} of {len(readings)} 95 % intervals hold."


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--renew", action="store_true")
    parser.add_argument("--campaigns", type=int, default=0)
    options = parser.parse_args()
    page = PAGE.read_text(encoding="utf-8")
    said = line(check(options.campaigns) if options.campaigns else "", page)
    if options.renew:
        PAGE.write_text(LINE.sub(lambda _: said, page), encoding="utf-8", newline="\n")
    print(said)


if __name__ == "__main__":
    main()
