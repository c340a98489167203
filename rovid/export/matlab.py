"""MATLAB: rovid's own equation and every number of it, as a struct."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from rovid.core.signatures import export_mark
from rovid.export.export_input import ExportInput
from rovid.export.export_result import ExportResult
from rovid.export.rovid_equation import (
    AXES,
    BASE,
    EQUATION,
    base_parameters,
    effect_names,
    rovid_result,
    thruster_entry,
)


def export(subject: ExportInput) -> ExportResult:
    """A .mat file of version 5 with one struct ``rovid``."""
    from scipy.io import loadmat, savemat

    keys = effect_names(subject)
    thrusters = [thruster_entry(subject, index, np.array) for index in range(len(subject.vehicle.thrusters))]
    values = base_parameters(subject) | {
        "equation": EQUATION,
        "axes": AXES,
        "thrusters": np.array(thrusters, dtype=object),
        "effects": {keys[key]: parameters for key, parameters in subject.effects.items()},
    }
    stream: Any = io.BytesIO()
    savemat(stream, {"rovid": values}, oned_as="column", long_field_names=True)
    # 116 bytes of text for people begin such a file.
    title = f"MATLAB 5.0 MAT-file. {export_mark('matlab')}. {subject.guess.file_notice}".ljust(116)
    content = title.encode() + stream.getvalue()[116:]
    again: Any = io.BytesIO(content)
    read = loadmat(again, simplify_cells=True)["rovid"]
    base = [float(read[name]) for name in BASE]
    effects = {}
    for key, parameters in subject.effects.items():
        fields = read["effects"][keys[key]]
        effects[key] = {name: float(fields[name]) for name in parameters}
    return rovid_result(subject, content, base, effects)
