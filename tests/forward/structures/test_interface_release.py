"""Ground that leaves in parts beside an interface: nothing moves at 0, all at 1; derivatives."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from geoident.model.actions import Water
from geoident.model.case import Stage, Support
from geoident.model.in_situ import GeostaticStress
from geoident.model.interfaces import Interface
from geoident.model.parameter import Parameter, Scalar
from tests.forward.structures.test_interfaces import NOTHING, meter
from tests.support.cases import material, model, rollers
from tests.support.derivatives import assert_exact
from tests.support.inner_faces import with_inner_faces
from tests.support.meshes import box, regroup


def pit(stages: tuple[Stage, ...], parameters: tuple[Parameter, ...] = (), **limits):
    """Saturated ground with a pit; the interface runs along its side and on below it."""
    mesh = with_inner_faces(
        box("quad8", (4, 4), size=(4.0, 4.0)), joint=lambda x: abs(x[..., 0] - 2.0) < 1e-9
    )
    mesh = regroup(mesh, pit=lambda x: (x[:, 0] < 2.0) & (x[:, 1] > 2.0))
    channels = (meter("J", (2.0, 1.0), "slip"), meter("K", (2.0, 1.5), "opening"))
    return model(
        mesh,
        materials={"ground": material("ground", 60e6, 0.3, 2000.0)},
        groups={"rock": "ground", "pit": "ground"},
        supports=(*rollers(2), Support("x1", (0,))),
        gravity=(0.0, -9.81),
        in_situ=GeostaticStress(Scalar(0.5)),
        water=Water(Scalar(3.0)),
        interfaces={"joint": Interface("joint", Scalar(1e8), Scalar(5e7), **limits)},
        stages=stages,
        parameters=parameters,
        channels=channels,
    )


def moved(staged, stage: int) -> np.ndarray:
    return staged.survey(NOTHING, fields=True).fields.displacement[stage]


@pytest.mark.parametrize("part", [0.0, 0.5])
def test_the_wall_moves_by_the_part_that_is_released(part):
    """Elastic ground moves by the part, through the interface and its water; then by the rest."""
    whole = moved(pit((Stage("dig", excavate=("pit",)),)), 1)
    begun = Stage("begin", excavate=("pit",), release={"pit": Scalar(part)})
    staged = pit((begun, Stage("end", release={"pit": Scalar(1.0)})))
    size = np.abs(whole).max()
    np.testing.assert_allclose(moved(staged, 1), part * whole, atol=1e-9 * size)
    np.testing.assert_allclose(moved(staged, 2), whole, atol=1e-9 * size)


def test_derivatives_by_the_part_and_the_friction_are_exact():
    """While the interface slips below the pit."""
    starts = {"part": 0.6, "phi": radians(20.0), "c": 1e3}
    one = {name: Scalar(1.0, name) for name in starts}
    begun = Stage("begin", excavate=("pit",), release={"pit": one["part"]})
    staged = pit(
        (begun, Stage("end", release={"pit": Scalar(1.0)})),
        tuple(Parameter(n, v, 0.2 * v, 1.6 * v) for n, v in starts.items()),
        friction=one["phi"], cohesion=one["c"], dilation=one["phi"],
    )  # fmt: skip
    p = np.array(list(starts.values()))
    states = staged.survey(p, fields=False).interfaces
    assert (states.slips | states.parts).any(axis=0).all()
    pairs = [(c.name, s) for c in staged.case.channels for s in ("begin", "end")]
    assert_exact(staged.response(pairs), p, tuple(starts))
