"""The analysis against CalculiX, an independent program, on the same mesh."""

from __future__ import annotations

import numpy as np
import pytest
from support import calculix
from support.anisotropy import every_symmetry, random_rotation
from support.cases import material, model
from support.meshes import KINDS_2D, KINDS_3D, box, regroup

from geoident.model.actions import Pressure, Traction
from geoident.model.case import Analysis, Material, Stage, Support
from geoident.model.parameter import Scalar


@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
@pytest.mark.parametrize("kind", [kind for kind in KINDS_3D if kind in calculix.TYPES])
def test_first_stage_equals_calculix(kind, tmp_path, verification):
    mesh = regroup(
        box(kind, (5, 5, 5), size=(5.0, 5.0, 5.0), distortion=0.05),
        hole=lambda c: np.all(np.abs(c - [0.5, 2.5, 2.5]) < [0.6, 1.5, 1.5], axis=1),
    )
    staged = calculix.opened(mesh)
    calculix.write_first_stage(staged, tmp_path / "stage.inp")
    peer = calculix.solve(tmp_path / "stage.inp", threads=1)
    ours = staged.survey(np.empty(0), fields=True).fields.displacement[-1]
    node = peer[:, 0].astype(int) - 1
    scale = np.abs(ours).max()
    # CalculiX prints seven digits.
    np.testing.assert_allclose(ours[node], peer[:, 1:], atol=2e-6 * scale)
    verification("calculix-stage", kind, node + 1, **sizes(peer[:, 1:], ours[node]))


def sizes(exact, found):
    """Lengths of displacements, as the manual has them."""
    return {"exact": np.linalg.norm(exact, axis=1), "found": np.linalg.norm(found, axis=1)}


# CalculiX makes wedges of two degrees of axisymmetric elements: 1 - cos(1 degree) is 1.5e-4. Its
# triangles have fewer points than ours, and the difference falls with the size of the elements
# (measured on 6, 12, 24 elements: 1.3e-2, 6e-3, 3.5e-3 for tri3; 5e-3, 2.3e-3, 1.1e-3 for tri6).
AXISYMMETRIC_DIFFERENCE = {"tri3": 8e-3, "tri6": 3e-3, "quad4": 2.5e-4, "quad8": 2e-4}


@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
@pytest.mark.parametrize("kind", KINDS_2D)
def test_squeezed_cylinder_equals_calculix(kind, tmp_path, verification):
    """A cylinder that stands fixed, pressed from the side and pulled outwards on top."""
    mesh = box(kind, (12, 12), size=(4.0, 4.0), distortion=0.1)
    staged = model(
        mesh,
        analysis=Analysis.AXISYMMETRIC,
        materials={"rock": material("rock", 8e9, 0.25)},
        groups={"all": "rock"},
        supports=(Support("y0", (0, 1)),),
        stages=(
            Stage(
                "load",
                loads={
                    "side": Pressure("x1", Scalar(3e6)),
                    "top": Traction("y1", (Scalar(1e6), Scalar(-2e6))),
                },
            ),
        ),
    )
    calculix.write_first_stage(staged, tmp_path / "stage.inp")
    peer = calculix.solve(tmp_path / "stage.inp", threads=1)
    ours = staged.survey(np.empty(0), fields=True).fields.displacement[-1]
    assert len(peer) == mesh.n_nodes
    node = peer[:, 0].astype(int) - 1
    difference = np.abs(ours[node] - peer[:, 1:3]).max() / np.abs(ours).max()
    assert difference < AXISYMMETRIC_DIFFERENCE[kind]
    verification("calculix-cylinder", kind, node + 1, **sizes(peer[:, 1:3], ours[node]))


@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
@pytest.mark.parametrize("symmetry", ["orthotropic", "anisotropic"])
def test_anisotropic_block_equals_calculix(symmetry, tmp_path, verification):
    """Inclined axes, which CalculiX turns by its own means, and entries without any symmetry."""
    rock = every_symmetry(random_rotation(np.random.default_rng(6)))[symmetry]
    staged = model(
        box("hex20", (4, 3, 3), distortion=0.1),
        materials={"rock": Material("rock", rock)},
        groups={"all": "rock"},
        supports=(Support("z0", (0, 1, 2)),),
        stages=(
            Stage(
                "load",
                loads={
                    "top": Traction("z1", (Scalar(1e6), Scalar(-2e6), Scalar(-3e6))),
                    "side": Pressure("x1", Scalar(2e6)),
                },
            ),
        ),
    )
    calculix.write_first_stage(staged, tmp_path / "stage.inp")
    peer = calculix.solve(tmp_path / "stage.inp", threads=1)
    ours = staged.survey(np.empty(0), fields=True).fields.displacement[-1]
    assert len(peer) == staged.mesh.n_nodes
    node = peer[:, 0].astype(int) - 1
    np.testing.assert_allclose(ours[node], peer[:, 1:], atol=2e-6 * np.abs(ours).max())
    verification("calculix-block", symmetry, node + 1, **sizes(peer[:, 1:], ours[node]))
