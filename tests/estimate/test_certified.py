"""The optimiser on certified problems: the nonlinear regressions of NIST's Statistical Reference Datasets.

The files in tests/estimate/certified are NIST's own (https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml, in the
public domain), each with data, two starts, and values and standard deviations certified to 11 digits.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.estimate.fisher_information import (
    Innovations,
    Jacobian,
    NormalEquations,
    grouped_scores,
    inverse_of_triangle,
)
from rovid.estimate.levenberg_marquardt import bounded_step, minimize
from rovid.estimate.parametrization import LOGARITHMS

FOLDER = Path(__file__).parent / "certified"
DIGITS = 9.0


def _rational(x: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any) -> Any:
    return (a + b * x + c * x**2 + d * x**3) / (1 + e * x + f * x**2 + g * x**3)


def _three_exponentials(x: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any) -> Any:
    return a * np.exp(-b * x) + c * np.exp(-d * x) + e * np.exp(-f * x)


def _two_peaks(x: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any) -> Any:
    return a * np.exp(-b * x) + c * np.exp(-(((x - d) / e) ** 2)) + f * np.exp(-(((x - g) / h) ** 2))


def _cycle(x: Any, period: Any, cosine: Any, sine: Any) -> Any:
    return cosine * np.cos(2 * np.pi * x / period) + sine * np.sin(2 * np.pi * x / period)


MODELS: dict[str, Callable[..., Any]] = {
    "Misra1a": lambda x, a, b: a * (1.0 - np.exp(-b * x)),
    "Misra1b": lambda x, a, b: a * (1.0 - (1.0 + b * x / 2.0) ** -2),
    "Misra1c": lambda x, a, b: a * (1.0 - (1.0 + 2.0 * b * x) ** -0.5),
    "Misra1d": lambda x, a, b: a * b * x / (1.0 + b * x),
    "Chwirut1": lambda x, a, b, c: np.exp(-a * x) / (b + c * x),
    "Chwirut2": lambda x, a, b, c: np.exp(-a * x) / (b + c * x),
    "Lanczos1": _three_exponentials,
    "Lanczos2": _three_exponentials,
    "Lanczos3": _three_exponentials,
    "Gauss1": _two_peaks,
    "Gauss2": _two_peaks,
    "Gauss3": _two_peaks,
    "DanWood": lambda x, a, b: a * x**b,
    "Kirby2": lambda x, a, b, c, d, e: _rational(x, a, b, c, 0.0, d, e, 0.0),
    "Hahn1": _rational,
    "Thurber": _rational,
    # x, y: of the logarithm of y.
    "Nelson": lambda x, a, b, c: a - b * x[0] * np.exp(-c * x[1]),
    "MGH17": lambda x, a, b, c, d, e: a + b * np.exp(-x * d) + c * np.exp(-x * e),
    "MGH09": lambda x, a, b, c, d: a * (x**2 + x * b) / (x**2 + x * c + d),
    "MGH10": lambda x, a, b, c: a * np.exp(b / (x + c)),
    "ENSO": lambda x, a, b, c, d, e, f, g, h, i: a + _cycle(x, 12.0, b, c) + _cycle(x, d, e, f) + _cycle(x, g, h, i),
    "Rat42": lambda x, a, b, c: a / (1.0 + np.exp(b - c * x)),
    "Rat43": lambda x, a, b, c, d: a / (1.0 + np.exp(b - c * x)) ** (1.0 / d),
    "Eckerle4": lambda x, a, b, c: a / b * np.exp(-0.5 * ((x - c) / b) ** 2),
    "BoxBOD": lambda x, a, b: a * (1.0 - np.exp(-b * x)),
    "Roszman1": lambda x, a, b, c, d: a - b * x - np.arctan(c / (x - d)) / np.pi,
    "Bennett5": lambda x, a, b, c: a * (b + x) ** (-1.0 / c),
}
# From the farther start of these the optimiser does not find the certified minimum. They are rated of average (MGH17)
# and higher difficulty.
_ONLY_NEAR = frozenset({("MGH17", 1), ("BoxBOD", 1), ("MGH10", 1)})
# The residuals of Lanczos1 are 1e-13 of the data, and their sum of squares has 3 digits in double precision. The
# likelihood of Bennett5 is flat by the threshold of `inverse_of_triangle`.
_DIGITS_OF_ERRORS = {"Lanczos1": 3.0, "Bennett5": 1.0}


@dataclass(frozen=True)
class Regression:
    """Stand-in for an objective: innovations are residuals, and half their sum of squares is minimised.

    The coordinates are the parameters over their start values. The places of rovid's logarithmic coordinates, in which
    the optimiser takes no step of more than one, are left empty.
    """

    model: Callable[..., Any]
    x: FloatArray
    y: FloatArray
    start: FloatArray
    simd_slots_left: int = 0
    bfgs_pairs: int = 0

    @property
    def places(self) -> list[int]:
        return [at for at in range(len(self.start) + len(LOGARITHMS)) if at not in LOGARITHMS]

    @property
    def parametrization(self) -> SimpleNamespace:
        free = np.full(len(self.start) + len(LOGARITHMS), np.inf)
        return SimpleNamespace(bounds=(-free, free))

    def values(self, x: FloatArray) -> FloatArray:
        return np.asarray(x[self.places] * self.start)

    def evaluate(self, points: Sequence[FloatArray]) -> list[Innovations]:
        with np.errstate(over="ignore", invalid="ignore"):
            errors = [self.model(self.x, *self.values(x)) - self.y for x in points]
        return [Innovations(np.nan_to_num(error, nan=1e100), np.ones_like(error)) for error in errors]

    def value_of(self, here: Innovations) -> float:
        with np.errstate(over="ignore"):
            return min(0.5 * float(here.error @ here.error), 1e300)

    def evaluate_with_spare(self, x: FloatArray) -> tuple[Innovations, list[Innovations]]:
        return self.evaluate([x])[0], []

    def jacobian(self, x: FloatArray, known: Any = None) -> Iterator[Jacobian]:
        (here,) = self.evaluate([x])
        matrix = np.zeros((2 * len(self.y), len(x)))
        for at, step in zip(self.places, 1e-30j * np.diag(self.start), strict=True):
            # The derivative by a complex step has no error of differences.
            matrix[: len(self.y), at] = self.model(self.x, *(self.values(x) + step)).imag / 1e-30
        yield Jacobian(slice(0, len(self.y)), np.concatenate((here.error, np.zeros_like(self.y))), matrix)


def read(name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows of (start 1, start 2, certified value, certified standard deviation); x; y."""
    text = (FOLDER / f"{name}.dat").read_text()
    rows = re.findall(r"^\s*b\d\s*=\s*(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", text, re.MULTILINE)
    y, *x = np.array([line.split() for line in text.split("Data:")[-1].splitlines()[1:] if line.strip()], dtype=float).T
    return np.array(rows, dtype=float), np.squeeze(x), np.log(y) if "log[y] =" in text else y


def digits(found: FloatArray, certified: FloatArray) -> float:
    """Least number of equal digits of all values: NIST's log relative error, at most the 11 that are certified."""
    return float(np.min(-np.log10(np.maximum(np.abs(found / certified - 1.0), 1e-11))))


def test_all_of_nist_are_here() -> None:
    assert len(MODELS) == 27
    assert {path.stem for path in FOLDER.glob("*.dat")} == set(MODELS)


@pytest.mark.parametrize("start", [1, 2])
@pytest.mark.parametrize("name", MODELS)
def test_values_and_standard_errors_are_the_certified_ones(name: str, start: int) -> None:
    rows, x, y = read(name)
    problem: Any = Regression(MODELS[name], x, y, rows[:, start - 1])
    first = np.zeros(len(rows) + len(LOGARITHMS))
    first[problem.places] = 1.0
    far = (name, start) in _ONLY_NEAR
    at = minimize(problem, first, iterations=500 if far else 2000, tolerance=0.0).x
    if far:
        assert digits(problem.values(at), rows[:, 2]) < 0.0
        return
    # Below the square root of the machine's precision no step changes the sum of squares. The optimiser's own step goes
    # on without that test.
    assert digits(problem.values(at), rows[:, 2]) >= 5.0
    for _ in range(12):
        equations = NormalEquations.from_jacobians(problem.jacobian(at))
        at = at + bounded_step(at, *equations, 0.0, problem.parametrization.bounds)
    triangle, _ = grouped_scores(problem.jacobian(at), [])
    variance = 2.0 * problem.value_of(*problem.evaluate([at])) / (len(y) - len(rows))
    errors = np.sqrt(variance * np.diag(inverse_of_triangle(triangle[:, problem.places]))) * np.abs(problem.start)
    assert digits(problem.values(at), rows[:, 2]) >= DIGITS
    assert digits(errors, rows[:, 3]) >= _DIGITS_OF_ERRORS.get(name, DIGITS)
