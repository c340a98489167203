"""Simulating 1 hour at 20 Hz: rovid's compiled loop against the same loop in C at -O2."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rovid.effects.base import Body
from rovid.model.kernels import simulate

SOURCE = r"""
#include <math.h>
static double acceleration(double r, double t, double i, double q, double l) { return (t - (q*fabs(r) + l)*r)/i; }
void simulate(long n, const double *time, const double *torque, double i, double q, double l, double r0,
              double *rate, double *angle) {
    rate[0] = r0; angle[0] = 0.0;
    for (long k = 0; k + 1 < n; k++) {
        double r = rate[k], a = angle[k], dt = time[k+1] - time[k];
        double balance = q > 0.0 ? sqrt(fabs(torque[k])/q) : 0.0;
        if (l > 0.0) balance = q > 0.0 ? fmin(balance, fabs(torque[k])/l) : 0.0;
        double stiffness = (2.0*q*fmax(fabs(r), balance) + l)/i, wanted = dt*stiffness/0.2;
        int steps = wanted > 1.0 ? (int)wanted + 1 : 1;
        double h = dt/steps;
        for (int s = 0; s < steps; s++) {
            double k1 = acceleration(r, torque[k], i, q, l), r2 = r + 0.5*h*k1;
            double k2 = acceleration(r2, torque[k], i, q, l), r3 = r + 0.5*h*k2;
            double k3 = acceleration(r3, torque[k], i, q, l), r4 = r + h*k3;
            double k4 = acceleration(r4, torque[k], i, q, l);
            a += h*(r + 2.0*r2 + 2.0*r3 + r4)/6.0;
            r += h*(k1 + 2.0*k2 + 2.0*k3 + k4)/6.0;
        }
        rate[k+1] = r; angle[k+1] = a;
    }
}
"""
PARAMETERS = (5057.0, 3532.0, 132.0, 0.0)
REPEATS = 15


def compiled(source: str, folder: Path, *flags: str) -> ctypes.CDLL:
    """C ``source`` as a library, made in ``folder``, which holds no other."""
    (folder / "loop.c").write_text(source)
    command = ["cc", "-O2", *flags, "-shared", "-fPIC", "-o", "loop.so", "loop.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "loop.so"))


def c_loop(folder: Path) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    function = compiled(SOURCE, folder).simulate
    array = np.ctypeslib.ndpointer(dtype=np.float64, flags="C")
    function.argtypes = [ctypes.c_long, array, array, *[ctypes.c_double] * 4, array, array]
    function.restype = None

    def run(instants: np.ndarray, torque: np.ndarray) -> np.ndarray:
        rate, angle = np.empty_like(instants), np.empty_like(instants)
        function(len(instants), instants, torque, *PARAMETERS, rate, angle)
        return rate

    return run


def seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def main() -> None:
    *numbers, initial = PARAMETERS
    body = Body(*numbers)
    instants = np.arange(0.0, 3600.0, 0.05)
    torque = 150.0 * np.sin(2 * np.pi * instants / 40.0)
    with tempfile.TemporaryDirectory() as name:
        reference = c_loop(Path(name))
        rate, _ = simulate(instants, torque, body, initial)
        assert np.allclose(rate, reference(instants, torque), rtol=0, atol=1e-12)  # same arithmetic, another compiler
        pairs = [
            (seconds(lambda: simulate(instants, torque, body, initial)), seconds(lambda: reference(instants, torque)))
            for _ in range(REPEATS)
        ]
    ours, c = np.median(pairs, axis=0)
    print(f"simulate 1 h at 20 Hz: rovid {1e3 * ours:.2f} ms, C -O2 {1e3 * c:.2f} ms, ratio {ours / c:.2f} (limit 2)")


if __name__ == "__main__":
    main()
