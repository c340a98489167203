"""Output error by lmfit: Levenberg-Marquardt over a simulation in Python."""

from __future__ import annotations

import lmfit

from benchmarks.peers.log import HIGH, LOW, NAMES, START, Floats, read, say
from benchmarks.peers.motion import simulated


def main() -> None:
    time, torque, heading = read()
    begin = lmfit.Parameters()
    for name, value, low, high in zip(NAMES, START, LOW, HIGH, strict=True):
        begin.add(name, value, min=low, max=high)

    def residual(parameters: lmfit.Parameters) -> Floats:
        values = [float(parameters[name].value) for name in NAMES]
        return heading - simulated(time, torque, heading[0], *values)

    found = lmfit.minimize(residual, begin)
    say([found.params[name].value for name in NAMES])


if __name__ == "__main__":
    main()
