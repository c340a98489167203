"""The section on exports."""

from __future__ import annotations

import math

from rovid.export.resimulation import Mismatch
from rovid.export.run_export import ExportLoss, VerifiedExport
from rovid.present.tables import exports
from tests.present.page.test_controller_tables import cells


def test_each_reason_is_given_once() -> None:
    size = Mismatch(percent_of_range=7.6, rms=0.01)
    lag = ExportLoss(what="thruster_lag:rotor", why="there is none", percent_of_range=7.6)
    wave = ExportLoss(what="wave_torque", why="its phase is not known", percent_of_range=math.nan)
    made = {
        name: VerifiedExport(content="", mismatch=size, kept_mismatch=size, losses=losses, warnings=())
        for name, losses in {"gz-sim": (lag, wave), "vrx": (lag,), "json": ()}.items()
    }
    assert cells(exports.formats_table(made), "not held, % of range") == [
        "thruster lag (rotor) 7.6; wave torque –",
        "thruster lag (rotor) 7.6",
        "–",
    ]
    assert exports.loss_reasons(made) == [
        ("gz-sim, vrx", "thruster lag (rotor)", "there is none"),
        ("gz-sim", "wave torque", "its phase is not known"),
    ]
