"""Cases put together in code, for tests of the forward model."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from geoident.fem.solvers import pick_solver
from geoident.forward.analysis.stage import StageEnd
from geoident.forward.checks import check_on_mesh
from geoident.forward.ground.elasticity import elastic_matrix
from geoident.forward.in_situ.stress import InSituStress, StressPlaces
from geoident.forward.model import StagedModel, staged_model
from geoident.forward.stages import CaseOnMesh
from geoident.model.case import Analysis, Case, FitSettings, Material, Support
from geoident.model.dual import ParameterPoint
from geoident.model.gauges import Channel
from geoident.model.ground import Isotropic, PointField
from geoident.model.in_situ import InSitu
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Scalar


def material(
    name: str, E: float | Scalar, nu: float | Scalar, density: float | Scalar = 0.0
) -> Material:
    """An isotropic material; numbers or parameters."""
    return Material(name, Isotropic(E=as_scalar(E), nu=as_scalar(nu)), as_scalar(density))


def as_scalar(value: float | Scalar) -> Scalar:
    return value if isinstance(value, Scalar) else Scalar(float(value))


def make_case(mesh: Mesh, **changes: Any) -> Case:
    """A case on a mesh with a fit nobody asks for; ``changes`` are fields of `Case`."""
    settings: dict[str, Any] = {
        "title": "test",
        "analysis": Analysis.SOLID if mesh.dim == 3 else Analysis.PLANE_STRAIN,
        "mesh_file": "",
        "parameters": (),
        "materials": {},
        "groups": {},
        "supports": (),
        "in_situ": None,
        "gravity": None,
        "loads": {},
        "stages": (),
        "channels": (),
        "readings": (),
        "fit": FitSettings((GaussNewtonOptions(),)),
    }
    return Case(**{**settings, **changes})


def rollers(dim: int) -> tuple[Support, ...]:
    """No motion across the planes x = min, y = min (, z = min)."""
    return tuple(Support(f"{'xyz'[axis]}0", (axis,)) for axis in range(dim))


def displacement(
    name: str, point: tuple[float, ...], direction: tuple[float, ...], *, zero: str = "virgin"
) -> Channel:
    """A channel that reads one component of the displacement of a point."""
    return Channel(name, name, "displacement", None, point, direction, 1e-4, zero, ("gauges", name))


def model(mesh: Mesh, **changes: Any) -> StagedModel:
    """A staged model of a case made by `make_case`."""
    case = make_case(mesh, **changes)
    return staged_model(as_before(mesh), case, solver=pick_solver("auto"))


_BEFORE: deque[Mesh] = deque(maxlen=4)


def as_before(mesh: Mesh) -> Mesh:
    """A mesh of before that has the same numbers, or this one.

    Tests make their mesh anew for each model. What is found of the same object (faces, overlaps,
    loose pieces, the order of elimination: `geoident.forward.of_mesh`) is found once: that was more
    than half of the time of a small model.
    """
    for known in _BEFORE:
        if _same(known, mesh):
            return known
    _BEFORE.append(mesh)
    return mesh


def _same(one: Mesh, other: Mesh) -> bool:
    """Whether two meshes have the same numbers and names; changed in place, they have not."""

    def blocks_are(a: tuple[ElementBlock, ...], b: tuple[ElementBlock, ...]) -> bool:
        return len(a) == len(b) and all(
            p.kind == q.kind
            and np.array_equal(p.nodes, q.nodes)
            and np.array_equal(p.numbers, q.numbers)
            for p, q in zip(a, b, strict=True)
        )

    def groups_are(a: Mapping[str, np.ndarray], b: Mapping[str, np.ndarray]) -> bool:
        return list(a) == list(b) and all(np.array_equal(a[name], b[name]) for name in a)

    return (
        np.array_equal(one.points, other.points)
        and one.file == other.file
        and blocks_are(one.blocks, other.blocks)
        and blocks_are(one.facets, other.facets)
        and groups_are(one.groups, other.groups)
        and groups_are(one.facet_groups, other.facet_groups)
        and groups_are(one.node_groups, other.node_groups)
    )


FieldsOf = Callable[[CaseOnMesh], Sequence[PointField]]
"""Makes the fields of a case once its strain points are known."""


def model_with_fields(mesh: Mesh, fields_of: FieldsOf, **changes: Any) -> StagedModel:
    """A staged model of a case made by `make_case`, with constants that are fields."""
    on_mesh, gauges = check_on_mesh(make_case(mesh, **changes), mesh)
    fields = tuple(fields_of(on_mesh))
    on_mesh = on_mesh.with_fields(on_mesh.case, fields)
    return StagedModel(on_mesh, gauges, solver=pick_solver("auto"))


def field_on(
    on_mesh: CaseOnMesh,
    material: str,
    constant: str,
    modes_at: Callable[[np.ndarray], np.ndarray],
    **changes: Any,
) -> PointField:
    """A field of a material whose modes (q, n) are a function of positions (q, dim)."""
    points = on_mesh.material_points(material)
    modes = modes_at(on_mesh.discretization.points.position[points])
    return PointField(
        **{
            "material": material,
            "constant": constant,
            "surface": None,
            "points": points,
            "known": np.zeros(len(points)),
            "modes": modes,
            "names": tuple(f"{material}.{constant}.mode-{k + 1}" for k in range(modes.shape[1])),
            "pull": np.zeros(len(points)),
            "reference": 1.0,
            **changes,
        }
    )


NOWHERE = ParameterPoint({}, ())
"""The point of a case without parameters."""


def imbalance(staged: StagedModel) -> float:
    """Of the in-situ stress of a case without parameters, relative to the forces at work."""
    return float(staged.analysis.virgin(NOWHERE)[1][0])


def virgin(staged: StagedModel) -> StageEnd:
    """The state before the first stage of a case without parameters."""
    return next(staged.at(np.empty(0)).states())


def moduli_at(material: Material, values: dict[str, float], n_strain: int) -> np.ndarray:
    """The elasticity matrix (s, s) of a material at parameter values."""
    found = elastic_matrix(material.elastic, ParameterPoint(values, ()), section=n_strain < 6)
    return found.value[:n_strain, :n_strain]


def in_situ_stress(
    model: InSitu | None, positions: np.ndarray, values: dict[str, float] | None = None
) -> np.ndarray:
    """Stress (n_strain, m) of one model at positions (m, dim), without topography."""
    mesh = Mesh(np.empty((0, positions.shape[1])), ())
    groups = np.zeros(len(positions), dtype=np.int64)
    on_mesh = CaseOnMesh(make_case(mesh, in_situ=model), mesh)
    found = InSituStress(on_mesh, StressPlaces(positions, groups))
    return found.columns(ParameterPoint(values or {}, ()))[..., 0]
