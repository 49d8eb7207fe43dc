"""The table of forces in linings and bolts in a result file: ``/structures``, SI."""

from __future__ import annotations

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter
from geoident.model.result import MemberForces

GROUP = "structures"


def write_members(file: h5py.File, table: MemberForces) -> None:
    """Writes ``/structures``, one row a straight piece of a lining or wall, or a bar.

    The axis ``member`` holds names such as ``lining:12``. Forces of linings are per metre out of
    plane or of circumference, those of bars are of one bar. ``N_hoop`` stands there if there are
    shells, ``prestress`` if bars were stressed: the force to which, at which stages.
    """
    pairs = zip(table.structures, table.numbers, strict=True)
    axes = {
        "member": [f"{name}:{number}" for name, number in pairs],
        "stage": table.stages,
        "end": ("first", "second"),
        "axis": ("x", "y", "z")[: table.ends.shape[2]],
    }
    out = TableWriter(file, GROUP, axes)
    out.add("structure", table.structures, "member")
    out.add("number", np.asarray(table.numbers, dtype=np.int64), "member")
    out.add("per_metre", table.per_metre, "member")
    out.add("points", table.ends, "member", "end", "axis", unit="m")
    out.add("N", table.axial, "member", "stage", unit="N, or N/m where per_metre")
    out.add("M", table.moment, "member", "end", "stage", unit="N m/m")
    out.add("Q", table.shear, "member", "stage", unit="N/m")
    if np.isfinite(table.hoop).any():
        out.add("N_hoop", table.hoop, "member", "stage", unit="N/m")
    if np.isfinite(table.prestress).any():
        out.add("prestress", table.prestress, "member", "stage", unit="N")


def read_members(file: h5py.File) -> MemberForces:
    """The forces in linings and bolts."""
    group = TableReader(file, GROUP)
    structures, stages = group.texts("structure"), group.texts("stage")
    n, k = len(structures), len(stages)
    nowhere = np.full((n, k), np.nan)
    return MemberForces(
        structures=structures,
        numbers=group.ints("number", n),
        stages=stages,
        ends=group.floats("points", n, 2, len(group.texts("axis"))),
        axial=group.floats("N", n, k),
        moment=group.floats("M", n, 2, k),
        shear=group.floats("Q", n, k),
        per_metre=group.bools("per_metre", n),
        hoop=group.floats("N_hoop", n, k) if "N_hoop" in group else nowhere,
        prestress=group.floats("prestress", n, k) if "prestress" in group else nowhere,
    )
