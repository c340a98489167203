"""The time that a computation may take, and its progress."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from rovid.core.spmd import agreed

ProgressCallback = Callable[[str], None]
# Seconds between two messages on the progress of one step.
_PROGRESS_INTERVAL = 1.0
# Default budget of a diagnosis in s, for each hour of logs or part of one.
SECONDS_PER_HOUR = 60.0


@dataclass(frozen=True, kw_only=True)
class BudgetUse:
    """What became of a budget."""

    seconds: float  #: The time allowed; infinite without an end.
    used: float  #: The time used in s.
    not_tried: tuple[str, ...]  #: Ids of effects, and other steps, that were left out.


@dataclass(eq=False)
class Budget:
    """Time from now on; without ``seconds`` there is no end."""

    seconds: float = math.inf
    #: Share of the time after which nothing optional is begun: the rest is for the answer.
    share: float = 0.75
    clock: Callable[[], float] = time.monotonic
    report: ProgressCallback = lambda _: None
    #: What was left out, in order.
    not_tried: dict[str, None] = field(default_factory=dict)
    _began: float = math.nan
    _is_over: bool = False
    _last_message: float = -math.inf

    def __post_init__(self) -> None:
        """Start the clock."""
        if math.isnan(self._began):
            self._began = self.clock()

    @property
    def used(self) -> float:
        """Time used so far in s."""
        return self.clock() - self._began

    def shorten(self, share: float) -> None:
        """Begin nothing optional after a smaller ``share`` of the time."""
        self.share = min(self.share, share)

    @property
    def use(self) -> BudgetUse:
        """What became of the budget so far."""
        return BudgetUse(seconds=self.seconds, used=self.used, not_tried=tuple(self.not_tried))

    @property
    def is_late(self) -> bool:
        """Whether this process finds that nothing optional is to be begun; its copies may not find so yet."""
        return self._is_over or self.used >= self.share * self.seconds

    @property
    def is_over(self) -> bool:
        """As `is_late`, decided by the first process for all its copies; they have to ask at the same place."""
        if not self._is_over and math.isfinite(self.seconds):
            self._is_over = agreed(lambda: self.is_late)
        return self._is_over

    def skips(self, what: str) -> bool:
        """Whether the optional step ``what`` has to be left out, which is noted."""
        if self.is_over:
            self.leave_out(what)
        return self._is_over

    def tell(self, words: str, done: int, total: int, since: float, item: str = "cause") -> None:
        """Report how far a step is that began at ``since`` by the clock; not more often than once a second."""
        now = self.clock()
        if now - max(since, self._last_message) >= _PROGRESS_INTERVAL:
            self._last_message = now
            left = (now - since) / max(done, 1) * (total - done)
            self.report(f"{words}: {item} {done + 1} of {total}, about {left:.0f} s …")

    def leave_out(self, what: str) -> None:
        """Note that ``what`` was left out for lack of time."""
        self._is_over = True
        self.not_tried[what] = None
