"""Sines of the heading: what effects with an amplitude and a phase share."""

from __future__ import annotations

import math

import numpy as np

from rovid.core.array_types import FloatArray


def canonical(numbers: FloatArray) -> FloatArray:
    """Pairs of amplitude and phase in rad, with amplitudes of 0 or more and phases between -pi and pi."""
    amplitude, phase = np.asarray(numbers, dtype=np.float64).reshape(-1, 2).T
    phase = np.where(amplitude < 0.0, phase + math.pi, phase)
    phase = np.arctan2(np.sin(phase), np.cos(phase))
    return np.column_stack((np.abs(amplitude), phase)).ravel()
