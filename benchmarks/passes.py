"""One pass of the likelihood over 1 hour at 20 Hz: rovid beside a filter in C, for one set of parameters and for four.

The pass is that of a fit, from coordinates to innovations. The C filter, `passes.c`, is of the same motion and written
apart from rovid's; what it says is compared with what rovid says. Times are the processor's, of all threads together.
"""

from __future__ import annotations

import ctypes
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.simulation import compiled
from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.output_error import fit_output_error
from rovid.estimate.parametrization import COMMON, DISTURBANCE
from rovid.jit.simd import LANES
from rovid.store.study import open_study
from tools.programme import Run, multilevel
from tools.trial_day import write_trial_day

HOUR = 3600.0
REPEATS = 15
# One at a time: a constant torque, a state, what drives the vehicle, and states with a variance of their own.
EFFECTS = ("bias_torque", "added_mass_memory", "thruster_lag", "wave_torque")
# Of the torque in use: the disturbance's limit. Of the usual rate: how well rovid takes the first rate to be known.
LIMIT, RATE_ERROR = 0.05, 0.2
# Of the innovations' standard deviation: the sums are the same, in another order.
SAME = 1e-6

Floats = NDArray[np.float64]
Sets = Sequence[Floats]


def readings_of(seconds: float, interval: float = 0.0) -> InnovationData:
    """What rovid makes of a log in both directions, at levels held for some seconds each; as `Readings.interval`."""
    levels = Run(name="log", pieces=multilevel(seconds))
    with tempfile.TemporaryDirectory() as name:
        write_trial_day(Path(name), seed=1, formats="csv", campaign=(levels,))
        study = open_study([Path(name)])
    assert study.runs is not None
    return InnovationData(study.runs.items, study.vehicle, fit_output_error(study.runs.items), interval=interval)


def points_about(misfit: InnovationLikelihood, count: int) -> Sets:
    """``count`` sets of coordinates, the first and others a little aside of it along all of them."""
    first = misfit.parametrization.initial()
    return [first + 1e-3 * k for k in range(count)]


class Reference:
    """The filter in C, for ``lanes`` sets of parameters at once, compiled for this machine in ``folder``."""

    def __init__(self, folder: Path, lanes: int) -> None:
        source = Path(__file__).with_name("passes.c").read_text()
        self.lanes = lanes
        self.function = compiled(source, folder, "-march=native", f"-DLANES={lanes}").filter
        array = np.ctypeslib.ndpointer(dtype=np.float64, flags="C")
        self.function.argtypes = [ctypes.c_long, *[array] * 7]
        self.function.restype = None

    def prepared(self, misfit: InnovationLikelihood, points: Sets) -> Callable[[], list[Innovations]]:
        """One pass over the log of ``misfit`` with as many ``points`` as there are lanes."""
        (time,), (angle,) = misfit.data.times, misfit.data.angles
        ((known, _),) = misfit.data.innovation_samples
        (chunk,) = misfit.data.chunks
        drive = chunk.inputs.between_steps(misfit.parametrization.model(points[0]))
        sets = np.column_stack([_set(misfit, x) for x in points])
        log = time, drive.torque, drive.timing_moment, angle
        innovation, variance = (np.empty((len(time), self.lanes)) for _ in range(2))

        def run() -> list[Innovations]:
            self.function(len(innovation), *log, sets, innovation, variance)
            return [Innovations(innovation[known, k], variance[known, k]) for k in range(self.lanes)]

        return run


def _set(misfit: InnovationLikelihood, x: Floats) -> Floats:
    """A column of what `passes.c` calls a Set."""
    model, (rate,) = misfit.parametrization.model(x), misfit.data.initial_rates
    return np.array([*model.values[:3], *np.exp(x[DISTURBANCE:COMMON]), rate, RATE_ERROR * misfit.data.rms_rate])


def farthest(these: Sequence[Innovations], those: Sequence[Innovations]) -> float:
    """How far innovations and their standard deviations are from others at most, as a share of the latter."""
    shares = []
    for one, other in zip(these, those, strict=True):
        scatter = np.sqrt(other.variance)
        off = np.abs(one.error - other.error), np.abs(np.sqrt(one.variance) - scatter)
        shares.append(float(np.max(np.maximum(*off) / scatter)))
    return max(shares)


def nanoseconds(calls: Sequence[Callable[[], object]], counts: Sequence[int]) -> Floats:
    """Median processor time of each call by its count, in ns; the calls take turns."""
    taken = np.array([[processor_seconds(call) for call in calls] for _ in range(REPEATS)])
    return np.asarray(1e9 * np.median(taken, axis=0) / np.array(counts))


def processor_seconds(call: Callable[[], object]) -> float:
    begun = time.process_time()
    call()
    return time.process_time() - begun


def beside_c(misfit: InnovationLikelihood) -> None:
    """Print rovid's time beside that of the filter in C."""
    points, samples = points_about(misfit, LANES), len(misfit.data.run_index)
    ours = misfit.evaluate(points)
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as four:
        alone = Reference(Path(one), 1).prepared(misfit, points[:1])
        abreast = Reference(Path(four), LANES).prepared(misfit, points)
        off = farthest(ours[:1], alone()), farthest(ours, abreast())
        assert max(off) < SAME, f"the filter in C says something else: {off}"
        calls = [lambda: misfit.evaluate(points[:1]), lambda: misfit.evaluate(points), alone, abreast]
        taken = nanoseconds(calls, [samples, LANES * samples, samples, LANES * samples])
    for who, ns in zip(("rovid, 1 set", f"rovid, {LANES} sets", "C, 1 set", f"C, {LANES} sets"), taken, strict=True):
        print(f"{who:34} {ns:6.1f} ns, {ns / taken[2]:5.2f} times C with one set, {ns / taken[3]:5.2f} with {LANES}")
    print(
        f"innovations of C are those of rovid to {off[0]:.0e} of their scatter, those of {LANES} sets to {off[1]:.0e}"
    )


def by_effect(readings: InnovationData) -> None:
    """Print rovid's time with an effect in the model, what drives the vehicle worked out anew each time."""
    misfits = [
        InnovationLikelihood(readings, LIMIT, effects) for effects in ((), *((effect_named(n),) for n in EFFECTS))
    ]
    calls = [partial(from_anew, misfit, points_about(misfit, LANES), count()) for misfit in misfits]
    for call in calls:
        call()  # compiled, where that was not done before
    taken = nanoseconds(calls, [LANES * len(readings.run_index)] * len(calls))
    for name, ns in zip(("no effect", *EFFECTS), taken, strict=True):
        who = f"rovid, {LANES} sets, {name}"
        print(f"{who:34} {ns:6.1f} ns, {ns / taken[0]:5.2f} times that without effect")


def from_anew(misfit: InnovationLikelihood, points: Sets, times: Iterator[int]) -> None:
    """Evaluate shifted points, so that no cached torque is used."""
    aside = 1e-9 * next(times)
    misfit.evaluate([x + aside for x in points])


def main() -> None:
    readings = readings_of(HOUR)
    print(f"A pass over {HOUR / 3600.0:g} h at 20 Hz, processor time by sample and set of parameters:")
    if shutil.which("cc") is None:
        print("no C compiler (cc) is here: rovid's times stand alone")
    else:
        beside_c(InnovationLikelihood(readings, LIMIT))
    by_effect(readings)


if __name__ == "__main__":
    main()
