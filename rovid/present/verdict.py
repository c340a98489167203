"""What a diagnosis comes to, in words: the same at a terminal and on the page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rovid.diagnose.thresholds import ESTABLISHED
from rovid.diagnose.result import Diagnosis, Finding
from rovid.trial.assumptions import Assumptions

# Surer than not.
_EVEN = 0.5


def verdict_sentence(diagnosis: Diagnosis, guess: Assumptions) -> str:
    """The whole diagnosis in one plain sentence."""
    # Simulations on the page, and of the parameter file, have what was found.
    model = f"The plain model{guess.curve_clause}"
    if diagnosis.verdict == "found":
        return f"{model} misses {join_words([cause_name(finding) for finding in diagnosis.findings])}."
    if diagnosis.verdict == "suspected":
        return f"{model} may miss {cause_name(diagnosis.suspects[0])}."
    if diagnosis.verdict == "nothing_found":
        return "Nothing was found: the model explains these data."
    if diagnosis.verdict == "unexplained":
        return f"{model} misses something that no effect of the catalogue explains."
    return "There is too little data for a diagnosis."


def cause_name(finding: Finding) -> str:
    """A cause by name, and what it cannot be told from."""
    effects = (finding.effect, *finding.indistinguishable)
    return join_words([finding.estimate.axis.reword(effect.title) for effect in effects], "or")


def confidence_words(finding: Finding) -> str:
    """How sure a cause is, in a word and as odds."""
    sure = finding.probability
    if sure >= ESTABLISHED:
        word = "established"
    elif sure >= _EVEN:
        word = "likely, not established"
    else:
        word = "possible, not established"
    return f"{word}: {odds_words(sure)}"


def odds_words(sure: float) -> str:
    """A probability as odds, "odds 19 to 1"."""
    return f"odds {_odds(sure)}"


def _odds(sure: float) -> str:
    odds = sure / max(1.0 - sure, 1e-9)
    if odds >= 1.0:
        return f"{_plain(odds)} to 1"
    return f"1 to {_plain(1.0 / odds)}"


def _plain(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def improvement_sentence(errors: Mapping[str, tuple[float, float]]) -> str:
    """What share of each error, without and with what was found, is gone.

    Where a restart forgets what the water remembers one may have grown.
    """
    gone, grown = [], []
    for what, (without, with_it) in errors.items():
        share = 100.0 * (1.0 - with_it / without) if without else 0.0
        if share >= 0.0:
            gone.append(f"{share:.0f} % of the {what}")
        else:
            grown.append(f"the {what} {-share:.0f} % larger")
    parts = [f"{join_words(gone)} gone"] if gone else []
    return f"{', '.join([*parts, *grown])}, on data that the fit never saw."


def join_words(texts: Sequence[str], last: str = "and") -> str:
    """As in "a, b and c", with ``last`` before the last."""
    return f" {last} ".join(_joined(texts))


def _joined(texts: Sequence[str]) -> Iterator[str]:
    """All but the last in one text, and the last."""
    if len(texts) > 1:
        yield ", ".join(texts[:-1])
    yield from texts[-1:]
