"""One likelihood pass over 1 hour at 20 Hz: rovid's compiled Kalman filter against the same loop in C at -O2."""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.simulation import REPEATS, compiled, seconds
from rovid.ground.lanes import LANES
from rovid.model.batch import Abreast, Driven, Logged
from rovid.model.drive import Drive
from rovid.model.kernels import innovations, simulate
from rovid.model.model import Model

SOURCE = r"""
#include <math.h>
static const double NODES[3] = {0.1127016653792583, 0.5, 0.8872983346207417};
static const double WEIGHTS[3] = {5.0/18.0, 8.0/18.0, 5.0/18.0};
static double acceleration(double r, double t, double i, double q, double l) { return (t - (q*fabs(r) + l)*r)/i; }
static void pushed(double t, double a, double b, double i, double *angle, double *rate) {
    double first = a + b, second = a*a + a*b + b*b, third = (a + b)*(a*a + b*b);
    *rate = t/i*(1.0 - t/2.0*(first - t/3.0*(second - t/4.0*third)));
    *angle = 0.5*t*t/i*(1.0 - t/3.0*(first - t/4.0*(second - t/5.0*third)));
}
void filter(long n, const double *time, const double *torque, const double *angle, const double *base,
            const double *noise, const double *start, double *innovation, double *variance) {
    double i = base[0], q = base[1], l = base[2], sigma = noise[0], tau = noise[1], damping = l/i;
    double a = angle[0], r = start[0], d = 0.0, origin = angle[0];
    double p00 = noise[2]*noise[2], p01 = 0, p02 = 0, p11 = start[1]*start[1], p12 = 0, p22 = sigma*sigma;
    double h = 0, fade = 1, mean = 1, fresh = 0, grown = 0, left[3] = {0, 0, 0};
    for (long k = 0; k < n; k++) {
        if (k > 0) {
            double dt = time[k] - time[k-1], push = torque[k-1];
            double soon = fmin(fabs(r) + dt*fabs(push)/i, fmax(fabs(r), sqrt(fabs(push)/(q + 1e-12))));
            double stiffness = fmax(damping, (2.0*q*soon + l)/i) + 1.0/tau, wanted = dt*stiffness/0.3;
            int steps = wanted > 1.0 ? (int)wanted + 1 : 1;
            if (dt/steps != h) {
                h = dt/steps; fade = exp(-h/tau); mean = (1.0 - fade)*tau/h;
                fresh = sigma*sigma*(1.0 - fade*fade); grown = 2.0*sigma*sigma/tau*h;
                for (int m = 0; m < 3; m++) left[m] = exp(-NODES[m]*h/tau);
            }
            for (int s = 0; s < steps; s++) {
                double t = push + d*mean, b = a - origin;
                double k1 = acceleration(r, t, i, q, l), r2 = r + 0.5*h*k1;
                double k2 = acceleration(r2, t, i, q, l), r3 = r + 0.5*h*k2;
                double k3 = acceleration(r3, t, i, q, l), r4 = r + h*k3;
                double k4 = acceleration(r4, t, i, q, l);
                b += h*(r + 2.0*r2 + 2.0*r3 + r4)/6.0;
                r += h*(k1 + 2.0*k2 + 2.0*k3 + k4)/6.0;
                a = b + origin; damping = (2.0*q*fabs(r2) + l)/i;
                double early = (1.0 - fade)*d*h*h/(12.0*i);
                a += early; r -= damping*early; d *= fade;
                double part = damping*h, f02, f12;
                double f11 = 1.0 - part*(1.0 - 0.5*part*(1.0 - part/3.0*(1.0 - 0.25*part)));
                double f01 = h*(1.0 - 0.5*part*(1.0 - part/3.0*(1.0 - 0.25*part)));
                pushed(h, damping, 1.0/tau, i, &f02, &f12);
                double n00 = 0, n01 = 0, n02 = 0, n11 = 0, n12 = 0;
                for (int m = 0; m < 3; m++) {
                    double c0, c1, c2 = left[m], w = grown*WEIGHTS[m];
                    pushed(NODES[m]*h, damping, 1.0/tau, i, &c0, &c1);
                    n00 += w*c0*c0; n01 += w*c0*c1; n02 += w*c0*c2; n11 += w*c1*c1; n12 += w*c1*c2;
                }
                double q00 = p00 + f01*p01 + f02*p02, q01 = p01 + f01*p11 + f02*p12, q02 = p02 + f01*p12 + f02*p22;
                double q11 = f11*p11 + f12*p12, q12 = f11*p12 + f12*p22;
                p00 = q00 + f01*q01 + f02*q02 + n00; p01 = f11*q01 + f12*q02 + n01; p02 = fade*q02 + n02;
                p11 = f11*q11 + f12*q12 + n11; p12 = fade*q12 + n12; p22 = fade*fade*p22 + fresh;
            }
        }
        double s = p00 + noise[2]*noise[2], e = angle[k] - a, g0 = p00/s, g1 = p01/s, g2 = p02/s;
        innovation[k] = e; variance[k] = s;
        a += g0*e; r += g1*e; d += g2*e;
        p11 -= g1*p01; p12 -= g1*p02; p22 -= g2*p02;
        p02 *= 1.0 - g0; p01 *= 1.0 - g0; p00 *= 1.0 - g0;
    }
}
"""
BASE = np.array([5057.0, 3532.0, 132.0])
NOISE = np.array([3.0, 4.0, 2e-4, 1.0])
START = np.array([0.0, 0.02])
MODEL = Model(inertia=5057.0, quadratic_drag=3532.0, linear_drag=132.0)


def c_loop(folder: Path) -> Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    function = compiled(SOURCE, folder).filter
    array = np.ctypeslib.ndpointer(dtype=np.float64, flags="C")
    function.argtypes = [ctypes.c_long, *[array] * 8]
    function.restype = None

    def run(instants: np.ndarray, torque: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        innovation, variance = np.empty_like(instants), np.empty_like(instants)
        function(len(instants), instants, torque, angle, BASE, NOISE, START, innovation, variance)
        return innovation, variance

    return run


def main() -> None:
    instants = np.arange(0.0, 3600.0, 0.05)
    torque = 150.0 * np.sin(2 * np.pi * instants / 40.0)
    angle = simulate(instants, torque, MODEL.body, 0.0)[1]
    angle = angle + np.random.default_rng(1).normal(0.0, 2e-4, len(angle))
    held = Drive.held(torque)
    driven = Driven.of([held] * LANES, [angle] * LANES)
    models = Abreast.of([MODEL] * LANES, [NOISE] * LANES)
    readings = Logged(
        begins=held.begins,
        time=instants,
        rate=np.full(len(instants), np.nan),
        start=np.zeros(1),
        first=START[np.newaxis],
        row=np.column_stack((np.arange(len(instants)), np.full(len(instants), -1))),
    )

    def ours() -> tuple[np.ndarray, np.ndarray]:
        # One model in all lanes: what a single one takes.
        errors, variances = innovations(readings, driven, models)
        return errors[0], variances[0]

    with tempfile.TemporaryDirectory() as name:
        reference = c_loop(Path(name))
        error, variance = ours()
        same, spread = reference(instants, torque, angle)
        assert np.allclose(error[1:], same[1:], rtol=0, atol=1e-11)  # same arithmetic, another compiler
        assert np.allclose(variance[1:], spread[1:], rtol=1e-8)
        pairs = [(seconds(ours), seconds(lambda: reference(instants, torque, angle))) for _ in range(REPEATS)]
    mine, c = np.median(pairs, axis=0)
    print(
        f"likelihood of 1 h at 20 Hz: rovid {1e3 * mine:.2f} ms, C -O2 {1e3 * c:.2f} ms, ratio {mine / c:.2f} (limit 2)"
    )


if __name__ == "__main__":
    main()
