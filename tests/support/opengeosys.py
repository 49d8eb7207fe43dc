"""Ground that consolidates as input of OpenGeoSys, an independent finite element program.

Its process HYDRO_MECHANICS has displacements of the second and pressures of the first order on the
same mesh (Taylor-Hood), as ours has. It steps by backward Euler. Its law of Mohr-Coulomb ground
(MFront's MohrCoulombAbboSloan) rounds edges and tip: where ours has the closed form of a confined
column to 1e-5, it is 0.7 % beside it. So it judges elastic ground only.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np

from geoident.model.mesh import Mesh

PROGRAM = shutil.which("ogs")
REMEDY = "OpenGeoSys is not installed: pip install ogs, in an environment of its own, on the PATH"
GAMMA_W = 9810.0
"""N/m3: conductivities are divided by it."""


@dataclass(frozen=True)
class Clay:
    """Ground of an element group, SI.

    Attributes:
        E: Young's modulus.
        nu: Poisson's ratio.
        k: conductivity along each axis.
        biot: Biot's coefficient.
    """

    E: float
    nu: float
    k: tuple[float, ...]
    biot: float

    @property
    def storage(self) -> float:
        """1 / Biot's modulus as it has it, of water that keeps its volume and no pores: 1/Pa."""
        return self.biot * (1.0 - self.biot) * 3.0 * (1.0 - 2.0 * self.nu) / self.E


def solve(
    mesh: Mesh,
    folder: Path,
    ground: Mapping[str, Clay],
    *,
    axial: bool = False,
    fixed: Mapping[str, Sequence[int]],
    drained: str,
    loaded: tuple[str, float],
    times: Sequence[float],
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """A pressure on a face for ever, on ground that was without stress.

    Args:
        mesh: of one kind of second-order elements.
        folder: where the files go; it must exist.
        ground: element group to its material.
        axial: the plane is half a section about the axis x = 0.
        fixed: facet group to the directions that cannot move there.
        drained: facet group without pressure.
        loaded: facet group and the pressure on it, Pa.
        times: of the states that are wanted, s.
        steps: of equal length between two of them.

    Returns:
        Displacements (t, n_nodes, dim) and pressures (t, n_nodes).
    """
    (block,) = mesh.blocks
    material = np.empty(len(block.nodes), np.int32)
    for number, group in enumerate(ground):
        material[mesh.groups[group]] = number
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))
    cells = {"quad8": "quad8", "tri6": "triangle6", "hex20": "hexahedron20", "tet10": "tetra10"}
    whole = meshio.Mesh(
        points, [(cells[block.kind], block.nodes)], cell_data={"MaterialIDs": [material]}
    )
    whole.write(folder / "whole.vtu")
    faces = sorted({*fixed, drained, loaded[0]})
    for face in faces:
        _write_face(mesh, points, face, folder / f"{face}.vtu")
    path = folder / "case.prj"
    conditions = _conditions(mesh.dim, fixed, drained, loaded[0])
    path.write_text(_project(ground, faces, axial, conditions, loaded[1], times, steps))
    command = [str(PROGRAM), "-o", str(folder), str(path)]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout[-4000:] + run.stderr[-4000:]
    return _states(folder, mesh.dim, len(times), steps)


def _write_face(mesh: Mesh, points: np.ndarray, face: str, path: Path) -> None:
    """A facet group as a mesh of its own, which knows its nodes in the whole."""
    members = set(mesh.facet_groups[face].tolist())
    first = 0
    for facets in mesh.facets:
        rows = [r for r in range(len(facets.nodes)) if first + r in members]
        first += len(facets.nodes)
        if not rows:
            continue
        nodes, local = np.unique(facets.nodes[rows], return_inverse=True)
        kind = {3: "line3", 6: "triangle6", 8: "quad8"}[facets.nodes.shape[1]]
        meshio.Mesh(
            points[nodes],
            [(kind, local.reshape(len(rows), -1))],
            point_data={"bulk_node_ids": nodes.astype(np.uint64)},
        ).write(path)


def _states(folder: Path, dim: int, n: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """What it wrote at the end of each span, behind the step in which the load comes."""
    moved, pressed = [], []
    for state in range(1, n + 1):
        data = meshio.read(folder / f"out_{1 + state * steps}.vtu").point_data
        moved.append(data["displacement"][:, :dim])
        pressed.append(data["pressure_interpolated"].ravel())
    return np.array(moved), np.array(pressed)


def _tag(name: str, *content: str) -> str:
    return f"<{name}>{''.join(content)}</{name}>"


def _constant(name: str, *values: float) -> str:
    numbers = " ".join(f"{value:.15e}" for value in values)
    return _tag("property", _tag("name", name), _tag("type", "Constant"), _tag("value", numbers))


def _parameter(name: str, *values: float) -> str:
    numbers = " ".join(f"{value:.15e}" for value in values)
    return _tag("parameter", _tag("name", name), _tag("type", "Constant"), _tag("values", numbers))


def _conditions(dim: int, fixed, drained: str, loaded: str) -> str:
    """The unknowns and what they are on the faces."""

    def condition(face: str, kind: str, component: int, parameter: str) -> str:
        return _tag(
            "boundary_condition",
            _tag("mesh", face),
            _tag("type", kind),
            _tag("component", str(component)),
            _tag("parameter", parameter),
        )

    def unknown(name: str, components: int, order: int, start: str, *on_faces: str) -> str:
        return _tag(
            "process_variable",
            _tag("name", name),
            _tag("components", str(components)),
            _tag("order", str(order)),
            _tag("initial_condition", start),
            _tag("boundary_conditions", *on_faces),
        )

    held = [condition(face, "Dirichlet", c, "none") for face, axes in fixed.items() for c in axes]
    pushed = condition(loaded, "Neumann", dim - 1, "load")
    motion = unknown("displacement", dim, 2, "no_motion", *held, pushed)
    without = condition(drained, "Dirichlet", 0, "none")
    return _tag("process_variables", motion, unknown("pressure", 1, 1, "none", without))


def _project(ground, faces, axial, conditions, load, times, steps) -> str:
    """The project file."""
    dim = len(next(iter(ground.values())).k)
    about = f' axially_symmetric="{str(axial).lower()}"'
    meshes = "".join(f"<mesh{about}>{name}.vtu</mesh>" for name in ("whole", *faces))
    laws, media = "", ""
    parameters = _parameter("no_motion", *[0.0] * dim) + _parameter("none", 0.0)
    parameters += _parameter("load", -load)
    for number, clay in enumerate(ground.values()):
        law, numbers = _law(number, clay)
        laws += law
        parameters += numbers
        media += f'<medium id="{number}">{_medium(clay)}</medium>'
    # the load comes in a step of hardly any length
    spans = [(1, 1e-6 * times[0])]
    spans += [(steps, span / steps) for span in np.diff([1e-6 * times[0], *times]).tolist()]
    pairs = "".join(
        _tag("pair", _tag("repeat", str(n)), _tag("delta_t", f"{dt:.15e}")) for n, dt in spans
    )
    outputs = _tag("pair", _tag("repeat", "1"), _tag("each_steps", "1"))
    outputs += _tag("pair", _tag("repeat", str(len(times))), _tag("each_steps", str(steps)))
    return _tag(
        "OpenGeoSysProject",
        _tag("meshes", meshes),
        _tag(
            "processes",
            _tag(
                "process",
                _tag("name", "water"),
                _tag("type", "HYDRO_MECHANICS"),
                _tag("integration_order", "3"),
                laws,
                _tag(
                    "process_variables",
                    _tag("displacement", "displacement"),
                    _tag("pressure", "pressure"),
                ),
                "<secondary_variables/>",
                _tag("specific_body_force", " ".join(["0"] * dim)),
            ),
        ),
        _tag("media", media),
        _tag(
            "time_loop",
            _tag(
                "processes",
                '<process ref="water">',
                _tag("nonlinear_solver", "newton"),
                _tag(
                    "convergence_criterion",
                    _tag("type", "PerComponentDeltaX"),
                    _tag("norm_type", "NORM2"),
                    _tag("abstols", " ".join(["1e-4", *["1e-12"] * dim])),  # Pa, m
                    _tag("reltols", " ".join(["1e-9"] * (1 + dim))),
                ),
                _tag("time_discretization", _tag("type", "BackwardEuler")),
                _tag(
                    "time_stepping",
                    _tag("type", "FixedTimeStepping"),
                    _tag("t_initial", "0"),
                    _tag("t_end", f"{times[-1]:.15e}"),
                    _tag("timesteps", pairs),
                ),
                "</process>",
            ),
            _tag(
                "output",
                _tag("type", "VTK"),
                _tag("prefix", "out"),
                _tag("suffix", "_{:timestep}"),
                _tag("timesteps", outputs),
                _tag(
                    "variables",
                    _tag("variable", "displacement"),
                    _tag("variable", "pressure_interpolated"),
                ),
            ),
        ),
        _tag("parameters", parameters),
        conditions,
        _tag(
            "nonlinear_solvers",
            _tag(
                "nonlinear_solver",
                _tag("name", "newton"),
                _tag("type", "Newton"),
                _tag("max_iter", "50"),
                _tag("linear_solver", "direct"),
            ),
        ),
        _tag(
            "linear_solvers",
            _tag(
                "linear_solver",
                _tag("name", "direct"),
                _tag("eigen", _tag("solver_type", "SparseLU"), _tag("scaling", "true")),
            ),
        ),
    )


def _medium(clay: Clay) -> str:
    """Water, grains and pores."""
    water = _constant("viscosity", 1.0) + _constant("density", 1000.0)
    phases = _tag("phase", _tag("type", "AqueousLiquid"), _tag("properties", water))
    grains = _constant("density", 2000.0)
    phases += _tag("phase", _tag("type", "Solid"), _tag("properties", grains))
    pores = _constant("porosity", 0.0) + _constant("biot_coefficient", clay.biot)
    pores += _constant("permeability", *np.diag(np.divide(clay.k, GAMMA_W)).ravel())
    pores += _constant("reference_temperature", 293.15)
    return _tag("phases", phases) + _tag("properties", pores)


def _law(number: int, clay: Clay) -> tuple[str, str]:
    """Constitutive law and its parameters."""
    law = _tag("type", "LinearElasticIsotropic")
    law += _tag("youngs_modulus", f"E{number}") + _tag("poissons_ratio", f"nu{number}")
    numbers = _parameter(f"E{number}", clay.E) + _parameter(f"nu{number}", clay.nu)
    return f'<constitutive_relation id="{number}">{law}</constitutive_relation>', numbers
