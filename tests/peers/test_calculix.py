"""The march against CalculiX, an independent program, on the same mesh."""

from __future__ import annotations

import numpy as np
import pytest
from support import calculix
from support.cases import material, model, rollers
from support.meshes import KINDS_3D, box, regroup

from geoident.model.case import Stage, Support
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Scalar


@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
@pytest.mark.parametrize("kind", KINDS_3D)
def test_first_stage_equals_calculix(kind, tmp_path):
    mesh = regroup(
        box(kind, (5, 5, 5), size=(5.0, 5.0, 5.0), distortion=0.05),
        hole=lambda c: np.all(np.abs(c - [0.5, 2.5, 2.5]) < [0.6, 1.5, 1.5], axis=1),
    )
    staged = model(
        mesh,
        materials={"rock": material("rock", 8e9, 0.25)},
        groups={"rock": "rock", "hole": "rock"},
        supports=(*rollers(3), Support("x1", (0,)), Support("y1", (1,))),
        in_situ=HeimStress(K0=Scalar(1.3), vertical=Scalar(6e6)),
        stages=(Stage("open", excavate=("hole",)),),
    )
    calculix.write_first_stage(staged, tmp_path / "stage.inp")
    peer = calculix.solve(tmp_path / "stage.inp", threads=1)
    ours = staged.survey(np.empty(0), fields=True).fields.displacement[-1]
    node = peer[:, 0].astype(int) - 1
    scale = np.abs(ours).max()
    # CalculiX prints seven digits.
    np.testing.assert_allclose(ours[node], peer[:, 1:], atol=2e-6 * scale)
