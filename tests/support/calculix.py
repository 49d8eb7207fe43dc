"""One stage of a case as input of CalculiX, an independent finite element program.

CalculiX is given the mesh that is present at the first stage, the in-situ stress as initial
stress, the supports and the nodal forces that act; it finds the displacement that restores
equilibrium, which is what the analysis finds for that stage.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geoident.fem.elements import reference_element
from geoident.fem.solvers import pick_solver
from geoident.forward.actions.supports import fixed_dofs
from geoident.forward.model import StagedModel, staged_model
from geoident.io.case.file import read_case
from geoident.io.mesh.file import read_mesh
from geoident.model.case import Stage, Support
from geoident.model.dual import ParameterPoint
from geoident.model.ground import Anisotropic, Elastic, Orthotropic, constants
from geoident.model.in_situ import HeimStress
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar
from support.cases import in_situ_stress, material, model, rollers

PROGRAM = shutil.which("ccx")
REMEDY = "CalculiX is not installed: apt-get install calculix-ccx"
TYPES = {"tet4": "C3D4", "tet10": "C3D10", "hex8": "C3D8", "hex20": "C3D20"}
TYPES |= {"tri3": "CAX3", "tri6": "CAX6", "quad4": "CAX4", "quad8": "CAX8"}


def opened(mesh: Mesh) -> StagedModel:
    """Rock with a ``hole`` that the first stage excavates, on rollers and fixed at its corner."""
    return model(
        mesh,
        materials={"rock": material("rock", 8e9, 0.25)},
        groups={"rock": "rock", "hole": "rock"},
        supports=(*rollers(3), Support("x1", (0,)), Support("y1", (1,))),
        in_situ=HeimStress(K0=Scalar(1.3), vertical=Scalar(6e6)),
        stages=(Stage("open", excavate=("hole",)),),
    )


def write_first_stage(
    staged: StagedModel,
    path: Path,
    *,
    values: Mapping[str, float] | None = None,
    solver: str = "",
    removal: bool = False,
) -> None:
    """Write the first stage of a solid or axisymmetric model.

    An axisymmetric model has no in-situ stress: CalculiX turns its elements into wedges of two
    degrees, whose integration points are not ours.

    Args:
        staged: the model.
        path: of the input.
        values: of its parameters, SI; None for the start values.
        solver: of CalculiX, such as ``ITERATIVE CHOLESKY``; empty for its own choice.
        removal: the virgin state first, in a step of its own; the next one takes away what leaves.
    """
    values = {p.name: p.start for p in staged.case.parameters} | dict(values or {})
    before = 0 if removal else 1
    state, present = staged.sequence.states[before], staged.sequence.present(before)
    with path.open("w") as out:
        _write_nodes(staged, out)
        _write_elements(staged, present, before, out)
        for group, material in state.materials.items():
            _write_material(group, staged.case.materials[material].elastic, values, out)
        fixed, touched = fixed_dofs(staged.on_mesh), staged.systems[before].touched
        dim = staged.mesh.dim
        out.write("*BOUNDARY\n")
        for dof in np.flatnonzero(fixed & touched):
            out.write(f"{dof // dim + 1},{dof % dim + 1},{dof % dim + 1}\n")
        if staged.case.in_situ is not None:
            _write_initial_stress(staged, values, present, out)
        for number in range(before, 2):
            _write_step(staged, number, values, solver, removal, out)


def write_file(case: str, path: Path, **options: Any) -> None:
    """The same of a case that stands in a file; options as for `write_first_stage`."""
    loaded = read_case(case)
    mesh = read_mesh(loaded.mesh_path, dim=loaded.case.analysis.dim)
    write_first_stage(staged_model(mesh, loaded.case, solver=pick_solver()), path, **options)


def _write_nodes(staged: StagedModel, out) -> None:
    out.write("*NODE, NSET=ALL\n")
    used = np.unique(np.concatenate([b.nodes.ravel() for b in staged.mesh.blocks]))
    for n in used:
        out.write(f"{n + 1}," + ",".join(f"{x:.12e}" for x in staged.mesh.points[n]) + "\n")


def _write_step(staged, number: int, values, solver: str, removal: bool, out) -> None:
    """The virgin state, 0, or the first stage, 1; with ``removal`` what leaves leaves in it."""
    dim, touched = staged.mesh.dim, staged.systems[number].touched
    out.write(f"*STEP\n*STATIC{', SOLVER=' + solver if solver else ''}\n")
    if removal and number == 1:
        out.write("*MODEL CHANGE, TYPE=ELEMENT, REMOVE\n")
        out.writelines(f"G{group}\n" for group in sorted(staged.sequence.states[1].leaving))
    out.write("*CLOAD, OP=NEW\n")
    forces = staged.actions.forces(number, ParameterPoint(values, ()))[:, 0]
    for dof in np.flatnonzero((forces != 0) & touched):
        out.write(f"{dof // dim + 1},{dof % dim + 1},{forces[dof]:.12e}\n")
    out.write("*NODE PRINT, NSET=ALL\nU\n*END STEP\n")


def solve(path: Path, *, threads: int) -> np.ndarray:
    """Run CalculiX on an input file; displacements (n, 4) as node number, x, y, z."""
    if PROGRAM is None:
        raise FileNotFoundError(REMEDY)
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads)}
    command = [PROGRAM, "-i", path.stem]
    subprocess.run(command, cwd=path.parent, env=environment, check=True, capture_output=True)
    lines = path.with_suffix(".dat").read_text().splitlines()
    rows = [line.split() for line in lines if line and line.split()[0].isdigit()]
    return np.array([[float(x) for x in row] for row in rows if len(row) == 4])


def _write_material(group: int, elastic: Elastic, values: Mapping[str, float], out) -> None:
    """E and nu; nine constants with the axes, which CalculiX turns itself; or the 21 entries."""
    numbers = {name: scalar.value(values) for name, scalar in constants(elastic).items()}
    section = f"*SOLID SECTION, ELSET=G{group}, MATERIAL=M{group}"
    out.write(f"*MATERIAL, NAME=M{group}\n")
    if isinstance(elastic, Orthotropic):
        axes = ",".join(f"{x:.12e}" for x in (*elastic.frame.first, *elastic.frame.second))
        order = ("E_1", "E_2", "E_3", "nu_12", "nu_13", "nu_23", "G_12", "G_13", "G_23")
        out.write("*ELASTIC, TYPE=ENGINEERING CONSTANTS\n")
        _write_eight([numbers[name] for name in order], out)
        section += f", ORIENTATION=O{group}"
        out.write(f"*ORIENTATION, NAME=O{group}, SYSTEM=RECTANGULAR\n{axes}\n")
    elif isinstance(elastic, Anisotropic):
        # CalculiX numbers 11, 22, 33, 12, 13, 23 and goes down the columns of the upper triangle.
        order = (1, 2, 3, 4, 6, 5)
        pairs = [sorted((order[i], order[j])) for j in range(6) for i in range(j + 1)]
        out.write("*ELASTIC, TYPE=ANISO\n")
        _write_eight([numbers.get(f"c{i}{j}", 0.0) for i, j in pairs], out)
    else:
        out.write("*ELASTIC\n")
        _write_eight([numbers["E"], numbers["nu"]], out)
    out.write(section + "\n")


def _write_eight(numbers: list[float], out) -> None:
    for first in range(0, len(numbers), 8):
        out.write(",".join(f"{x!r}" for x in numbers[first : first + 8]) + "\n")


def _write_elements(staged: StagedModel, present: np.ndarray, state: int, out) -> None:
    first = 0
    for block in staged.mesh.blocks:
        for group in staged.sequence.states[state].materials:
            mine = np.flatnonzero(
                (staged.sequence.group_of[first : first + len(block)] == group)
                & present[first : first + len(block)]
            )
            if len(mine):
                out.write(f"*ELEMENT, TYPE={TYPES[block.kind]}, ELSET=G{group}\n")
            for e in mine:
                words = [str(first + e + 1), *(str(n + 1) for n in block.nodes[e])]
                out.write(",".join(words[:12]) + (",\n" if words[12:] else "\n"))
                if words[12:]:
                    out.write(",".join(words[12:]) + "\n")
        first += len(block)


def _write_initial_stress(staged: StagedModel, values, present: np.ndarray, out) -> None:
    out.write("*INITIAL CONDITIONS, TYPE=STRESS\n")
    first = 0
    for block in staged.mesh.blocks:
        n_points = len(reference_element(block.kind).weights)
        centres = staged.mesh.points[block.nodes].mean(axis=1)
        stress = in_situ_stress(staged.case.in_situ, centres, values)
        xx, yy, zz, xy, yz, xz = stress
        for e in np.flatnonzero(present[first : first + len(block)]):
            row = [xx[e], yy[e], zz[e], xy[e], xz[e], yz[e]]
            text = ",".join(f"{v:.12e}" for v in row)
            for q in range(n_points):
                out.write(f"{first + e + 1},{q + 1},{text}\n")
        first += len(block)


def write_creep(
    staged: StagedModel,
    path: Path,
    parts: Mapping[str, Sequence[tuple[float, float, float]]],
    days: Sequence[float],
    steps: int,
) -> None:
    """Write the first stage of a solid that creeps in shear, in time; displacements at some days.

    CalculiX knows Norton's law alone, with the exponent 1 a dashpot in a row with the elastic
    spring. Elements of several such materials on the same nodes stand side by side: their stresses
    add up to that of a chain in a row (see `side_by_side`).

    Args:
        staged: the model.
        path: of the input.
        parts: element group to what stands side by side in it: E, nu, and the viscosity in shear,
            Pa d; infinite for elastic.
        days: at which displacements are printed, since the load.
        steps: of the first span of time; later spans have as many.
    """
    (block,) = staged.mesh.blocks
    with path.open("w") as out:
        _write_nodes(staged, out)
        first = 1
        for group, materials in parts.items():
            for k, (E, nu, viscosity) in enumerate(materials):
                name = f"{group}{k}"
                out.write(f"*ELEMENT, TYPE={TYPES[block.kind]}, ELSET={name}\n")
                for number, e in enumerate(staged.mesh.groups[group], first):
                    words = [str(number), *(str(n + 1) for n in block.nodes[e])]
                    out.write(",".join(words[:12]) + ",\n" + ",".join(words[12:]) + "\n")
                first += len(staged.mesh.groups[group])
                out.write(f"*MATERIAL, NAME={name}\n*ELASTIC\n{E:.12e},{nu!r}\n")
                if np.isfinite(viscosity):  # the rate is A q^1 t^0, and s = 2 eta e'
                    out.write(f"*CREEP\n{1.0 / (3.0 * viscosity):.12e},1.,0.\n")
                out.write(f"*SOLID SECTION, ELSET={name}, MATERIAL={name}\n")
        out.write("*BOUNDARY\n")
        for dof in np.flatnonzero(fixed_dofs(staged.on_mesh)):
            out.write(f"{dof // 3 + 1},{dof % 3 + 1},{dof % 3 + 1}\n")
        _write_step(staged, 1, {}, "", False, out)
        for span in np.diff([0.0, *days]).tolist():
            out.write("*STEP, INC=100000\n*VISCO, DIRECT, CETOL=1.\n")
            out.write(f"{span / steps:.12e},{span:.12e}\n")
            out.write(f"*NODE PRINT, NSET=ALL, FREQUENCY={steps}\nU\n*END STEP\n")


def side_by_side(
    G: float, kelvin: tuple[float, float], viscosity: float
) -> list[tuple[float, float]]:
    """Two springs with dashpots (G, eta) side by side that relax as a chain of Burgers does.

    The chain has the compliance 1 / G + 1 / (eta s) + 1 / (G_K + eta_K s) by s; its reciprocal, by
    partial fractions, is the sum of G s / (s + G / eta).

    Args:
        G: of its spring.
        kelvin: G_K and eta_K.
        viscosity: eta of its dashpot; infinite for none.
    """
    G_K, eta_K = kelvin
    fluid = 1.0 / viscosity
    # the compliance by G eta_K s (s + G_K / eta_K), as a polynomial of s
    poles = np.roots([eta_K, G_K + G + G * eta_K * fluid, G * G_K * fluid])
    other = poles[::-1]
    # the relaxation is G (eta_K s + G_K) s / (eta_K (s - one) (s - other))
    springs = G * (eta_K * poles + G_K) / (eta_K * (poles - other))
    pairs = zip(springs, poles, strict=True)
    return [(float(g), float(-g / pole) if pole else np.inf) for g, pole in pairs]
