"""Interfaces against contact in CalculiX, an independent program, on the same mesh.

Its contact has a linear pressure by overclosure and a shear stress by slip up to friction: k_n, k_s
and Coulomb's limit without cohesion and tension. Both meshes coincide at the contact.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import calculix
from support.cases import material, model
from support.inner_faces import with_inner_faces
from support.meshes import box, regroup

from geoident.forward.model import StagedModel
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.dual import ParameterPoint
from geoident.model.interfaces import Interface
from geoident.model.parameter import Scalar

E, NU, K_N, K_S, FRICTION = 5e9, 0.2, 5e9, 1e9, np.radians(30.0)
PRESS, PUSHES = -1e6, (2.0e5, 4.4e5, 5.3e5)
HEIGHT = 0.5


def block(along: int, friction: float = FRICTION) -> StagedModel:
    """A block of 4 m by 1 m by 0.5 m on a joint above another, pressed, then pushed along x."""
    mesh = box("hex8", (along, 2, 2), size=(4.0, 1.0, 2 * HEIGHT))
    mesh = with_inner_faces(mesh, joint=lambda x: abs(x[..., 2] - HEIGHT) < 1e-9)
    mesh = regroup(mesh, low=lambda x: x[:, 2] < HEIGHT)
    zero = Scalar(0.0)
    press = Traction("z1", (zero, zero, Scalar(PRESS)))
    stages = [Stage("press", loads={"weight": press})]
    for n, push in enumerate(PUSHES):
        stages.append(
            Stage(f"push {n}", loads={"thrust": Traction("z1", (Scalar(push), zero, zero))})
        )
    return model(
        mesh,
        materials={"rock": material("rock", E, NU)},
        groups={"rock": "rock", "low": "rock"},
        supports=(Support("z0", (0, 1, 2)),),
        interfaces={
            "joint": Interface("joint", Scalar(K_N), Scalar(K_S), friction=Scalar(friction))
        },
        stages=tuple(stages),
    )


def write(staged: StagedModel, path: Path) -> None:
    """The same for CalculiX: all its steps, with the forces that geoident has at the nodes."""
    mesh = staged.mesh
    (elements,) = mesh.blocks
    low = np.isin(np.arange(mesh.n_elements), mesh.groups["low"])
    z = mesh.points[elements.nodes][..., 2]
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n + 1}," + ",".join(f"{v:.12e}" for v in x) for n, x in enumerate(mesh.points)]
    lines.append("*ELEMENT, TYPE=C3D8, ELSET=ROCK")
    lines += [f"{e + 1}," + ",".join(map(str, c + 1)) for e, c in enumerate(elements.nodes)]
    lines += [
        "*MATERIAL, NAME=M",
        "*ELASTIC",
        f"{E},{NU}",
        "*SOLID SECTION, ELSET=ROCK, MATERIAL=M",
    ]
    above = np.flatnonzero(~low & (z.min(axis=1) < HEIGHT + 1e-9))
    below = np.flatnonzero(low & (z.max(axis=1) > HEIGHT - 1e-9))
    lines += ["*SURFACE, NAME=SLAVE", *(f"{e + 1},S1" for e in above)]
    lines += ["*SURFACE, NAME=MASTER", *(f"{e + 1},S2" for e in below)]
    lines += ["*SURFACE INTERACTION, NAME=I", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR",
              f"{K_N},0.", "*FRICTION", f"{np.tan(FRICTION):.12e},{K_S}",
              "*CONTACT PAIR, INTERACTION=I, TYPE=SURFACE TO SURFACE", "SLAVE,MASTER",
              "*BOUNDARY"]  # fmt: skip
    lines += [f"{n + 1},1,3" for n in np.flatnonzero(mesh.points[:, 2] == 0.0)]
    for number in range(1, len(staged.sequence.states)):
        forces = staged.actions.forces(number, ParameterPoint({}, ()))[:, 0]
        lines += ["*STEP, INC=1000", "*STATIC", "0.1,1.", "*CLOAD, OP=NEW"]
        lines += [f"{d // 3 + 1},{d % 3 + 1},{forces[d]:.12e}" for d in np.flatnonzero(forces)]
        lines += ["*NODE PRINT, NSET=ALL, FREQUENCY=1000", "U", "*END STEP"]
    path.write_text("\n".join([*lines, ""]))


# Contact in CalculiX has Gauss points on its faces, an interface of first order has its points at
# the nodes: the difference falls with the length of the elements.
@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
@pytest.mark.parametrize(
    ("along", "difference"),
    [(8, 0.035), pytest.param(16, 0.018, marks=pytest.mark.slow)],  # half as long: 3 s
)
def test_a_block_that_slips_equals_calculix(along, difference, tmp_path, verification):
    """Pressed, then pushed in three stages up to 0.92 of what friction holds."""
    staged = block(along)
    write(staged, tmp_path / "contact.inp")
    peer = calculix.solve(tmp_path / "contact.inp", threads=1)
    peer = peer.reshape(-1, staged.mesh.n_nodes, 4)[:, :, 1:]
    ours, elastic = (
        one.survey(np.empty(0), fields=True).fields.displacement[1:]
        for one in (staged, block(along, np.radians(80.0)))
    )
    scale = np.abs(ours).max(axis=(1, 2))
    off = np.abs(peer - ours).max(axis=(1, 2)) / scale
    assert (off < difference).all()
    assert np.abs(elastic - ours)[-1].max() > 3 * difference * scale[-1]  # and friction is met
    end = int(np.argmax(staged.mesh.points @ (1.0, 0.0, 1.0)))
    stages = np.arange(1, len(ours) + 1)
    verification(
        "calculix-contact", f"{along} elements", stages, exact=peer[:, end, 0],
        found=ours[:, end, 0],
    )  # fmt: skip
