"""Models of ground that yields, put together in code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.analysis.stage import StageEnd
from geoident.forward.model import StagedModel
from geoident.forward.openings.closed_forms import (
    GroundState,
    Opening,
    Rock,
    WallLimit,
    mohr_coulomb,
)
from geoident.model.actions import Pressure
from geoident.model.case import Material, Stage
from geoident.model.dual import Dual
from geoident.model.in_situ import ConstantStress
from geoident.model.mesh import Mesh
from geoident.model.parameter import Parameter, Scalar
from geoident.model.yielding import GivenPlanes, HoekBrown, MohrCoulomb, YieldPlane, YieldSurface
from support.cases import as_scalar, material, model, rollers
from support.meshes import opening

NOTHING = np.empty(0)


def rock(
    E: float | Scalar,
    nu: float | Scalar,
    *yields: YieldSurface,
    name: str = "rock",
    density: float | Scalar = 0.0,
    expansion: float | Scalar = 0.0,
) -> Material:
    """An isotropic material that yields."""
    plain = material(name, E, nu, density)
    return Material(name, plain.elastic, plain.density, as_scalar(expansion), yields)


def mohr(
    c: float | Scalar,
    phi: float | Scalar,
    *,
    psi: float | Scalar | None = None,
    tension: float | Scalar | None = None,
    planes: int | None = None,
    fit: str = "best",
) -> MohrCoulomb:
    """Mohr-Coulomb; numbers or parameters, angles in rad."""
    dilation = None if psi is None else as_scalar(psi)
    cut = None if tension is None else as_scalar(tension)
    return MohrCoulomb(as_scalar(c), as_scalar(phi), dilation, cut, planes, fit)


def hoek(
    sigci: float | Scalar, *, psi: float | Scalar | None = None, **constants: float | Scalar
) -> HoekBrown:
    """Hoek-Brown by mi, GSI and D or by mb, s and a; numbers or parameters, psi in rad."""
    numbers = {name: as_scalar(value) for name, value in constants.items()}
    return HoekBrown(as_scalar(sigci), dilation=None if psi is None else as_scalar(psi), **numbers)


def given(
    normals: np.ndarray, distances: Sequence[float | Scalar], hardening: float | Scalar = 0.0
) -> GivenPlanes:
    """Planes of normals (y, 6), made unit vectors with shears counted once, and distances."""
    units = normals / np.linalg.norm(normals, axis=1)[:, None]
    planes = tuple(
        YieldPlane(f"p{n}", tuple(map(float, unit)), as_scalar(k))
        for n, (unit, k) in enumerate(zip(units, distances, strict=True))
    )
    return GivenPlanes(planes, as_scalar(hardening))


def constant(*stress: float | Scalar, held: bool | None = None) -> ConstantStress:
    """In-situ stress the same everywhere; up to six components, the rest zero."""
    filled = [as_scalar(s) for s in stress] + [Scalar(0.0)] * (6 - len(stress))
    return ConstantStress(tuple(filled), held)


def parameters(**values: float) -> tuple[Parameter, ...]:
    """Parameters with wide bounds."""
    return tuple(
        Parameter(name, value, *sorted((value / 10, value * 10))) for name, value in values.items()
    )


def dual(number: float) -> Dual:
    """A number that depends on no parameter."""
    return Dual(np.array([number]))


def mohr_limit(c: float, phi: float, psi: float | None = None) -> WallLimit:
    """Mohr-Coulomb of the closed forms; associated without psi."""
    return mohr_coulomb(dual(c), dual(phi), dual(phi if psi is None else psi))


def analysed(
    staged: StagedModel, p: np.ndarray = NOTHING, *, explain: bool = True
) -> list[StageEnd]:
    """Copies of all states, with derivatives."""
    analysis = staged.at(p, RunOptions(explain=explain)).states()
    return [
        StageEnd(s.number, s.u.copy(), s.stress.copy(), s.members.copy(), s.yielded.copy())
        for s in analysis
    ]


@dataclass(frozen=True)
class Cavity:
    """A round opening in the plane, about an axis or in space, under an all-round stress.

    Args:
        pressure: of the far stress, Pa, compression positive.
        E: Young's modulus, Pa.
        nu: Poisson's ratio.
        radius: of the opening, m.
    """

    pressure: float = 30e6
    E: float = 6.7776e9
    nu: float = 0.21034
    radius: float = 1.0

    def mesh(self, kind: str, dim: int = 2, *, n: int, layers: int, reach: float) -> Mesh:
        """A quarter or octant; reach in radii."""
        r = self.radius
        return opening(kind, dim, n=n, layers=layers, radius=r, reach=reach * r)

    def staged(self, mesh: Mesh, *yields: YieldSurface, **changes: Any) -> StagedModel:
        """The opening made in one stage."""
        settings: dict[str, Any] = {
            "materials": {"rock": rock(self.E, self.nu, *yields)},
            "groups": {"core": "rock", "rock": "rock"},
            "supports": rollers(mesh.dim),
            "in_situ": constant(*(-self.pressure,) * 3),
            "stages": (Stage("open", excavate=("core",)),),
        }
        return model(mesh, **{**settings, **changes})

    def closed_form(self, limit: WallLimit, released: float = 1.0) -> GroundState:
        """The opening in the plane by its closed form, with a part of the stress released."""
        stress = dual(self.pressure)
        ground = Rock(dual(self.E), dual(self.nu), stress, stress)
        return Opening(self.radius, ground, limit).under((1.0 - released) * stress)

    def wall(self, staged: StagedModel) -> np.ndarray:
        """Nodes on the wall."""
        used = np.unique(staged.mesh.blocks[0].nodes)
        away = np.abs(np.linalg.norm(staged.mesh.points[used], axis=1) - self.radius)
        return used[away < 1e-9 * self.radius]

    def outwards(self, staged: StagedModel, end: StageEnd) -> np.ndarray:
        """Radial displacements (n,) of the nodes on the wall."""
        mesh, wall = staged.mesh, self.wall(staged)
        u = end.u[:, 0].reshape(mesh.n_nodes, mesh.dim)[wall]
        return np.sum(u * mesh.points[wall], axis=1) / self.radius

    def plastic_radius(self, staged: StagedModel, end: StageEnd) -> float:
        """Between the outermost point that yields and the next one."""
        r = np.linalg.norm(staged.discretization.points.position, axis=1)
        last = r[end.yielded].max()
        return float(0.5 * (last + r[(r > last) & ~end.yielded].min()))


def cylinder(
    mesh: Mesh, pressures: Sequence[float], *yields: YieldSurface, E: float, nu: float, **more: Any
) -> StagedModel:
    """A quarter of a thick ring whose core is absent, under pressures inside, stage by stage."""
    stages = tuple(
        Stage(f"p{k}", loads={"p": Pressure("wall", Scalar(p))}) for k, p in enumerate(pressures)
    )
    settings: dict[str, Any] = {
        "materials": {"rock": rock(E, nu, *yields)},
        "groups": {"core": None, "rock": "rock"},
        "supports": rollers(2),
        "stages": stages,
    }
    return model(mesh, **{**settings, **more})
