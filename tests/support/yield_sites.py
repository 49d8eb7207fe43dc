"""Sites whose strengths are sought: a deep opening dug in three parts, a plate with a hole.

Both with one, two, four or nine free distances of yield planes, after the founding paper: plane
strain, planes around the deviatoric stresses of the section, different distances in different
directions. Nine are either nine planes of one rock, or three of each of three layers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geoident.errors import ModelError
from geoident.forward.model import StagedModel
from geoident.identify.problem.problem import Problem
from geoident.model.actions import Traction
from geoident.model.case import Material, Stage, Support
from geoident.model.ground import Isotropic
from geoident.model.mesh import Mesh
from geoident.model.parameter import Parameter, Scalar
from geoident.model.yielding import GivenPlanes, YieldPlane

from .cases import displacement, model, rollers
from .meshes import opening, regroup, with_outer_faces
from .yielding import constant

E, NU = 1e10, 0.25
ACCURACY = 0.02
"""Standard deviation of a reading by the largest of them."""

LOW, HIGH = 0.2, 4.0
"""Bounds of the distances, in parts of the site's typical one."""


@dataclass(frozen=True)
class Site:
    """A staged model and what belongs to its identification.

    Args:
        model: the model.
        pairs: channel and stage of every reading.
        typical: a distance at which much yields, Pa.
    """

    model: StagedModel
    pairs: tuple[tuple[str, str], ...]
    typical: float


@dataclass(frozen=True)
class Task:
    """An identification whose answer is known: the problem, the truth (n,) and phi there."""

    problem: Problem
    truth: np.ndarray
    objective: float


def planes(names: list[str], count: int) -> GivenPlanes:
    """``count`` planes around the deviatoric stresses of the section, tied round and round."""
    found = []
    for j, angle in enumerate(2.0 * np.pi * np.arange(count) / count + 0.2):
        c, s = np.cos(angle), np.sin(angle)
        normal = np.array([c / 2, -c / 2, 0.0, s, 0.0, 0.0])
        normal /= np.linalg.norm(normal)
        name = names[j % len(names)]
        found.append(YieldPlane(f"p{j + 1}", tuple(map(float, normal)), Scalar(1.0, name)))
    return GivenPlanes(tuple(found))


def layers(free: int, layered: bool) -> list[GivenPlanes]:
    """The yield planes of each layer of rock."""
    names = [f"k{n + 1}" for n in range(free)]
    if layered:
        return [planes(names[3 * n : 3 * n + 3], 6) for n in range(3)]
    return [planes(names, {1: 8, 2: 8, 4: 8, 9: 9}[free])]


def deep_opening(free: int, *, elements: int = 500, layered: bool = False) -> Site:
    """A round opening in a stressed rock: heading, bench, invert."""
    n, rings = {200: (2, 5), 500: (3, 9), 2000: (6, 18), 10000: (13, 42)}[elements]
    mesh = opening("tri3", 2, n=n, layers=rings, radius=1.0, reach=8.0, whole=True)
    core = np.zeros(mesh.n_elements, bool)
    core[mesh.groups["core"]] = True
    mesh = regroup(
        mesh,
        heading=lambda c: core & (c[:, 1] > 0.1),
        bench=lambda c: core & (c[:, 0] > 0.0),
        invert=lambda c: core,
        **_thirds(layered),
    )
    found = layers(free, layered)
    rock = [g for g in ("low", "middle", "rock") if g in mesh.groups]
    groups = dict(zip(rock, _materials(found), strict=True))
    groups |= dict.fromkeys(("heading", "bench", "invert"), groups["rock"])
    stages = tuple(Stage(g, excavate=(g,)) for g in ("heading", "bench", "invert"))
    settings = {
        "groups": groups,
        "supports": (Support("outer", (0, 1)),),
        "in_situ": constant(-20e6, -30e6, -25e6, 3e6, held=True),
        "stages": stages,
    }
    return _site(mesh, found, settings, np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False), 1e7)


def notched_plate(free: int, *, elements: int = 500, layered: bool = False) -> Site:
    """A quarter of a plate with a hole, pulled at two sides in turn."""
    n, rings = {500: (6, 21), 2000: (12, 42)}[elements]
    mesh = _squared(opening("tri3", 2, n=n, layers=rings, radius=1.0, reach=5.0))
    core = np.zeros(mesh.n_elements, bool)
    core[mesh.groups["core"]] = True
    mesh = regroup(mesh, core=lambda c: core, **_thirds(layered, 1.2, 2.6))
    found = layers(free, layered)
    rock = [g for g in ("low", "middle", "rock") if g in mesh.groups]
    groups: dict[str, str | None] = {
        **dict(zip(rock, _materials(found), strict=True)),
        "core": None,
    }

    def pull(side: str, x: float, y: float) -> Traction:
        return Traction(side, (Scalar(x), Scalar(y)))

    stages = (
        Stage("along", loads={"x": pull("x1", 10e6, 0.0), "y": pull("y1", 0.0, 2e6)}),
        Stage("across", loads={"x": pull("x1", 1e6, 0.0), "y": pull("y1", 0.0, 11e6)}),
        Stage("skew", loads={"x": pull("x1", 7e6, -4e6), "y": pull("y1", -4e6, -5e6)}),
    )
    settings = {"groups": groups, "supports": rollers(2), "stages": stages}
    return _site(mesh, found, settings, np.linspace(0.0, np.pi / 2, 8), 1.1e7)


def task(site: Site, seed: int, *, noise: float = 0.0) -> Task:
    """Readings of a random truth that does not collapse, in three stages, and a random start."""
    rng, n = np.random.default_rng(seed), len(site.model.names)
    response = site.model.response(site.pairs)
    while True:
        truth = site.typical * np.exp(rng.uniform(np.log(0.75), np.log(1.4), n))
        try:
            exact = response.readings(truth)
            break
        except ModelError:
            continue
    sd = np.full(len(exact), ACCURACY * np.abs(exact).max())
    measured = exact + noise * sd * rng.standard_normal(len(exact))
    parameters = tuple(
        replace(q, start=float(site.typical * np.exp(rng.uniform(np.log(0.5), np.log(2.0)))))
        for q in site.model.case.parameters
    )
    phi = float(np.sum(((exact - measured) / sd) ** 2))
    return Task(Problem(response, measured, sd, parameters), truth, phi)


def _thirds(layered: bool, low: float = -0.4, high: float = 0.5) -> dict[str, Any]:
    if not layered:
        return {}
    return {"low": lambda c: c[:, 1] < low, "middle": lambda c: c[:, 1] < high}


def _materials(found: list[GivenPlanes]) -> list[str]:
    return [f"rock {n + 1}" for n in range(len(found))]


def _site(
    mesh: Mesh, found: list[GivenPlanes], settings: dict[str, Any], at: np.ndarray, typical: float
) -> Site:
    """Gauges around the opening: from the wall outwards, between radii of 1, 1.5 and 2.5."""
    elastic = Isotropic(Scalar(E), Scalar(NU))
    names = sorted({p.distance.parameter or "" for s in found for p in s.planes})
    channels = []
    for r in (1.0, 1.6):
        for n, angle in enumerate(at):
            d = np.array([np.cos(angle), np.sin(angle)])
            point = _nearest(mesh, r * d)
            channels.append(displacement(f"r{r:g} {n}", tuple(point), tuple(d)))
    parameters = tuple(
        Parameter(name, typical, LOW * typical, HIGH * typical, "log", None, "pressure", "MPa")
        for name in names
    )
    staged = model(
        mesh,
        materials={
            name: Material(name, elastic, yields=(surface,))
            for name, surface in zip(_materials(found), found, strict=True)
        },
        parameters=parameters,
        channels=tuple(channels),
        **settings,
    )
    pairs = tuple((c.name, s.name) for s in settings["stages"] for c in channels)
    return Site(staged, pairs, typical)


def _nearest(mesh: Mesh, place: np.ndarray) -> np.ndarray:
    """The node of the rock nearest to a place."""
    rock = np.concatenate([v for k, v in mesh.groups.items() if k in ("rock", "low", "middle")])
    nodes = np.unique(mesh.blocks[0].nodes[rock])
    return mesh.points[nodes[np.argmin(np.linalg.norm(mesh.points[nodes] - place, axis=1))]]


def _squared(mesh: Mesh) -> Mesh:
    """The round outer edge made square, gradually from the hole on."""
    r = np.linalg.norm(mesh.points, axis=1)
    reach = r.max()
    safe = np.where(r > 0, r, 1.0)
    square = 1.0 / np.maximum(np.abs(mesh.points / safe[:, None]).max(axis=1), 0.5)
    share = np.clip((r - 1.0) / (reach - 1.0), 0.0, 1.0) ** 2
    moved = mesh.points * (1.0 + share * (square - 1.0))[:, None]
    return with_outer_faces(replace(mesh, points=moved))
