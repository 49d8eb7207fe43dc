"""Nails in a wall with load cells on them: readings of forces beside displacements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.forward.model import StagedModel
from geoident.model.case import Stage
from geoident.model.gauges import Channel, Reads
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Bolts
from support.cases import displacement, material, model, rollers
from support.meshes import box, regroup

ENDS = (((1.1, 2.1), (3.4, 3.2)), ((1.2, 0.4), (3.6, 0.7)))
VALUES = {"E": 2e9, "EA": 3e8, "s": 1.5, "p": -2e6}


def cell(
    name: str, first, second, zero: str = "virgin", *, structure: str = "nails", member: int = 0
) -> Channel:
    """A load cell on a bar between two points; without zero it reads the force itself."""
    reads = Reads.VALUE if zero == "virgin" else Reads.CHANGE
    return Channel(
        name, name, "load-cell", first, second, (1.0, 0.0), 1e3, zero, ("gauges", name),
        dimension="force", unit="kN", reads=reads, quantity="N", structure=structure, member=member,
    )  # fmt: skip


def nailed(*channels: Channel, free: tuple[str, ...] = tuple(VALUES)) -> StagedModel:
    """A wall dug in two steps and nailed after the first; parameters are those named."""
    number = {n: Scalar(1.0, n) if n in free else Scalar(v) for n, v in VALUES.items()}
    across = replace(number["p"], factor=0.7 * number["p"].factor)
    mesh = regroup(
        box("quad8", (4, 4), size=(4.0, 4.0)),
        core=lambda x: (x[:, 0] < 1.0) & (x[:, 1] > 1.0) & (x[:, 1] < 2.0),
        upper=lambda x: (x[:, 0] < 1.0) & (x[:, 1] > 2.0) & (x[:, 1] < 3.0),
    )
    return model(
        mesh,
        parameters=tuple(
            Parameter(n, v, *sorted((v / 9, v * 9))) for n, v in VALUES.items() if n in free
        ),
        materials={"rock": material("rock", number["E"], 0.25)},
        groups=dict.fromkeys(("rock", "core", "upper"), "rock"),
        supports=rollers(2),
        in_situ=ConstantStress((number["p"], across, number["p"], *(Scalar(0.0),) * 3)),
        structures={"nails": Bolts(ENDS, number["s"], EA=number["EA"])},
        stages=(
            Stage("open", excavate=("core",)),
            Stage("bolt", build=("nails",)),
            Stage("go on", excavate=("upper",)),
            Stage("cut", dismantle=("nails",)),
        ),
        channels=channels,
    )


GAUGES = (
    displacement("d", (1.0, 1.5), (1.0, 0.0)),
    cell("n1", *ENDS[0]),
    cell("n2", *ENDS[1], member=1),
    cell("late", *ENDS[0], zero="go on"),
)
P = np.array(list(VALUES.values()))
