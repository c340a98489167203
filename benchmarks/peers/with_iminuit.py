"""Output error by iminuit: MIGRAD over a simulation in Python."""

from __future__ import annotations

from iminuit import Minuit
from iminuit.cost import LeastSquares

from benchmarks.peers.log import HIGH, LOW, NAMES, START, Floats, read, say
from benchmarks.peers.motion import simulated

# rad; the scale of the cost alone, for the errors are no white noise.
ERROR = 0.1


def main() -> None:
    time, torque, heading = read()

    def model(instants: Floats, inertia: float, quadratic_drag: float, linear_drag: float) -> Floats:
        return simulated(instants, torque, heading[0], inertia, quadratic_drag, linear_drag)

    fit = Minuit(LeastSquares(time, heading, ERROR, model), **dict(zip(NAMES, START, strict=True)))
    fit.limits = list(zip(LOW, HIGH, strict=True))
    fit.migrad()
    say([fit.values[name] for name in NAMES])


if __name__ == "__main__":
    main()
