"""Ground that differs from its model, for `wrong_models.py`: sites, truths and what is read.

The truths:

    right        nothing differs
    field-15     Young's modulus lognormal with sd 15 %, correlated over 20 m (field-30: 30 %)
    yielding     the rock yields where it is stressed most; up to the first bench that hardly shows
    accuracies   the gauges are three times less accurate than stated
    K0           fixed at 1.0 instead of 1.6 (cases/cavern: 1.4), one parameter less
    fault        a soft zone behind the right wall that the model lacks
    zeros        20 daily readings share the error of their zero, three accuracies large
    coarse       the model is a mesh of some 300 linear triangles (cases/cavern: 2700)
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import gmsh
import numpy as np
from scipy.spatial import cKDTree

from geoident.fem.solvers import pick_solver
from geoident.forward.model import StagedModel, staged_model
from geoident.io.case.file import read_case
from geoident.io.mesh.file import read_mesh
from geoident.model.case import Case, Material
from geoident.model.ground import Isotropic
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar
from geoident.model.yielding import MohrCoulomb

E, K0, VERTICAL, ACCURACY = 20e9, 1.6, 8e6, 0.12e-3
HALF, TOP = 10.0, 24.0
LENGTH, CLASSES = 20.0, 31
ZERO, DAYS = 3.0, 20
CAVERN = Path(__file__).resolve().parents[2] / "cases" / "cavern"

CASE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {{file: {mesh}}}
parameters:
  E:  {{start: 15 GPa, bounds: [1 GPa, 200 GPa], scale: log}}
{k0}
materials:
  rock: {{elastic: isotropic, E: $E, nu: 0.25}}
groups: {{rock: rock, pilot: rock, heading: rock, bench-1: rock, bench-2: rock}}
supports: {{left: x, right: x, bottom: y}}
in_situ: {{model: heim, vertical: 8 MPa, K0: {K0}}}
stages:
  - {{name: pilot, excavate: [pilot]}}
  - {{name: heading, excavate: [heading]}}
  - {{name: bench 1, excavate: [bench-1]}}
  - {{name: bench 2, excavate: [bench-2]}}
gauges:
{gauges}
readings: {readings}
fit: {{stages: [heading, bench 1]}}
"""
K0_FREE = "  K0: {start: 1.0, bounds: [0.3, 4]}"


# Meshes ------------------------------------------------------------------------------------------


def write_mesh(path: Path, *, size: float, order: int, growth: float = 0.15) -> None:
    """The cavern: groups rock, pilot, heading, bench-1, bench-2; edges left, right, bottom.

    Args:
        path: of the mesh.
        size: of the elements at the wall, m.
        order: of the elements.
        growth: of their size with the distance from the wall.
    """
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        boxes = [(-120.0, -100.0, 240.0, 240.0), (-3.0, 20.0, 6.0, 4.0), (-HALF, 16.0, 20.0, 8.0)]
        boxes += [(-HALF, 8.0, 20.0, 8.0), (-HALF, 0.0, 20.0, 8.0)]
        tags = [(2, occ.addRectangle(x, y, 0.0, dx, dy)) for x, y, dx, dy in boxes]
        occ.fragment(tags[:1], tags[1:])
        occ.synchronize()
        groups: dict[str, list[int]] = {}
        for _, tag in gmsh.model.getEntities(2):
            groups.setdefault(_region(*occ.getCenterOfMass(2, tag)[:2], tag), []).append(tag)
        for name, members in groups.items():
            gmsh.model.addPhysicalGroup(2, members, name=name)
        for name, box in {
            "left": (-120, -100, -120, 140),
            "right": (120, -100, 120, 140),
            "bottom": (-120, -100, 120, -100),
        }.items():
            x0, y0, x1, y1 = box
            near = gmsh.model.getEntitiesInBoundingBox(
                x0 - 1e-3, y0 - 1e-3, -1, x1 + 1e-3, y1 + 1e-3, 1, 1
            )
            gmsh.model.addPhysicalGroup(1, [tag for _, tag in near], name=name)
        walls = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(-11, -1, -1, 11, 25, 1, 1)]
        fields = gmsh.model.mesh.field
        near_wall, sized = fields.add("Distance"), fields.add("MathEval")
        fields.setNumbers(near_wall, "CurvesList", walls)
        fields.setNumber(near_wall, "Sampling", 200)
        fields.setString(sized, "F", f"{size} + {growth} * F{near_wall}")
        fields.setAsBackgroundMesh(sized)
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def _region(x: float, y: float, tag: int) -> str:
    """Group of a face by its centre; the rock, whose centre is in the cavern too, by its size."""
    if gmsh.model.occ.getMass(2, tag) > 1000.0:
        return "rock"
    if abs(x) < 3.0 and 20.0 < y < 24.0 and gmsh.model.occ.getMass(2, tag) < 25.0:
        return "pilot"
    return "heading" if y > 16.0 else "bench-1" if y > 8.0 else "bench-2"


# The case ----------------------------------------------------------------------------------------


def gauges(many: bool) -> list[str]:
    """Lines of the section `gauges`; about ten readings are fitted, or about a hundred."""
    crown = [-6.0, -2.0, 2.0, 6.0] if many else [0.0]
    heads = {"1": ("heading", [17.0, 18.5, 20.0, 21.5] if many else [20.0])}
    heads["2"] = ("bench 1", [9.0, 10.5, 12.0, 13.5] if many else [12.0])
    depths = [2.0, 4.0, 6.0, 10.0, 15.0, 22.0] if many else [5.0, 15.0]
    accuracy = f"{1e3 * ACCURACY:g} mm"
    lines = []
    for n, x in enumerate(crown):
        anchors = ", ".join(f"a{d:g}: [{x} m, {TOP + d} m]" for d in depths)
        zero = "pilot" if abs(x) < 3.0 else "heading"
        lines.append(
            f"  C{n}: {{kind: extensometer, head: [{x} m, {TOP} m], anchors: {{{anchors}}}, "
            f"accuracy: {accuracy}, zero: {zero}}}"
        )
    for level, (zero, heights) in heads.items():
        for n, y in enumerate(heights):
            for side, sign in (("L", -1), ("R", 1)):
                anchors = ", ".join(f"a{d:g}: [{sign * (HALF + d)} m, {y} m]" for d in depths)
                lines.append(
                    f"  {side}{level}{n}: {{kind: extensometer, head: [{sign * HALF} m, {y} m], "
                    f"anchors: {{{anchors}}}, accuracy: {accuracy}, zero: {zero}}}"
                )
        for n, y in enumerate([*heights, heights[-1] + 2.0]):
            lines.append(
                f"  V{level}{n}: {{kind: convergence, between: [[-{HALF} m, {y} m], "
                f"[{HALF} m, {y} m]], accuracy: {accuracy}, zero: {zero}}}"
            )
    return lines


def write_case(
    folder: Path, mesh: Path, readings: str, *, many: bool, fixed_k0: float | None
) -> Path:
    """The case in a folder.

    Args:
        folder: where.
        mesh: its mesh.
        readings: name of its file of readings, or ``[]``.
        many: gauges.
        fixed_k0: a number in place of the parameter K0.
    """
    text = CASE.format(
        mesh=mesh,
        k0=K0_FREE if fixed_k0 is None else "",
        K0="$K0" if fixed_k0 is None else fixed_k0,
        gauges="\n".join(gauges(many)),
        readings=readings,
    )
    path = folder / "case.yaml"
    path.write_text(text)
    return path


# Sites -------------------------------------------------------------------------------------------


@dataclass
class Site:
    """Meshes and the true case, made once.

    Args:
        folder: for files.
        many: gauges.
    """

    folder: Path
    many: bool = False
    kept: dict[str, Any] = field(default_factory=dict)

    fitted: ClassVar[tuple[str, ...]] = ("heading", "bench 1")
    later: ClassVar[tuple[str, ...]] = ("bench 2",)
    true: ClassVar[Mapping[str, float]] = {"E": E, "K0": K0}
    strength: ClassVar[tuple[float, float]] = (3.5e6, 40.0)
    """Cohesion, Pa, and friction, degrees, of the rock that yields."""

    @cached_property
    def truth(self) -> tuple[Case, Mesh]:
        """The true case and its mesh, homogeneous and elastic."""
        path = self.folder / "truth.msh"
        write_mesh(path, size=1.2, order=2)
        return self.read(path, RIGHT)

    @cached_property
    def model_mesh(self) -> Path:
        """The mesh to fit with."""
        path = self.folder / "model.msh"
        write_mesh(path, size=2.0, order=2, growth=0.3)
        return path

    @cached_property
    def coarse_mesh(self) -> Path:
        """One that is too coarse."""
        path = self.folder / "coarse.msh"
        write_mesh(path, size=4.0, order=1, growth=0.6)
        return path

    @cached_property
    def places(self) -> np.ndarray:
        """(m, 2) where a random modulus is drawn; each element has the value of the nearest, m."""
        return self.centres

    @cached_property
    def centres(self) -> np.ndarray:
        """(n_elements, 2) of the truth's elements, m."""
        return _centres(self.truth[1])

    @cached_property
    def root(self) -> np.ndarray:
        """(m, m) root of the exponential correlation of the places."""
        x = self.places
        distance = np.linalg.norm(x[:, None] - x[None], axis=2)
        return np.linalg.cholesky(np.exp(-distance / LENGTH) + 1e-9 * np.eye(len(x)))

    @cached_property
    def nearest(self) -> np.ndarray:
        """(n_elements,) the place of each element."""
        return np.asarray(cKDTree(self.places).query(self.centres)[1])

    def write(self, folder: Path, mesh: Path, readings: str, truth: Truth) -> Path:
        """The case in a folder, as it is modelled of a truth: see `write_case`."""
        return write_case(folder, mesh, readings, many=self.many, fixed_k0=truth.fixed_k0)

    def read(self, mesh: Path, truth: Truth) -> tuple[Case, Mesh]:
        """The case without readings on a mesh, as it is modelled of a truth."""
        path = self.write(self.folder, mesh, "[]", truth)
        return read_case(str(path)).case, read_mesh(str(mesh), dim=2)

    def homogeneous(self, edit: Callable[[Case], Case] = lambda case: case) -> np.ndarray:
        """(n_channels, n_stages) true readings of an edited case."""
        case, mesh = self.truth
        return self.readings(staged_model(mesh, edit(case), solver=pick_solver("auto")))

    def yielding(self) -> np.ndarray:
        """(n_channels, n_stages) true readings where the rock yields with `strength`."""
        surface = MohrCoulomb(Scalar(self.strength[0]), Scalar(np.radians(self.strength[1])))

        def edit(case: Case) -> Case:
            rock = replace(case.materials["rock"], yields=(surface,))
            return replace(case, materials={**case.materials, "rock": rock})

        return self.homogeneous(edit)

    def faulted(self) -> np.ndarray:
        """(n_channels, n_stages) true readings with the zone that the model lacks."""
        return self.heterogeneous(_fault(self))

    def readings(
        self, model: StagedModel, changed: Mapping[str, float] | None = None
    ) -> np.ndarray:
        """(n_channels, n_stages) of a model at the true parameters, but for those changed."""
        values = {**self.true, **(changed or {})}
        p = np.array([values[name] for name in model.names])
        return model.survey(p, fields=False, partial=True).computed

    def heterogeneous(self, log_factor: np.ndarray) -> np.ndarray:
        """(n_channels, n_stages) true readings where log E differs from the mean, (n_elements,)."""
        case, mesh = self.truth
        edges = np.linspace(log_factor.min(), log_factor.max() + 1e-9, CLASSES + 1)
        number = np.digitize(log_factor, edges) - 1
        parts: dict[str, list[str]] = {}
        groups, materials, of_group = {}, dict(case.materials), {}
        for name, members in mesh.groups.items():
            if case.groups[name] != "rock":
                groups[name], of_group[name], parts[name] = members, case.groups[name], [name]
                continue
            for k in np.unique(number[members]):
                part = f"{name}.{k}"
                groups[part] = members[number[members] == k]
                parts.setdefault(name, []).append(part)
                of_group[part] = f"rock.{k}"
        rock = case.materials["rock"]
        for k in np.unique(number):
            factor = float(np.exp(log_factor[number == k].mean()))
            materials[f"rock.{k}"] = _softer(rock, factor)
        stages = tuple(
            replace(
                s,
                excavate=tuple(part for name in s.excavate for part in parts[name]),
                install={part: new for name, new in s.install.items() for part in parts[name]},
            )
            for s in case.stages
        )
        there = replace(case, materials=materials, groups=of_group, stages=stages)
        model = staged_model(replace(mesh, groups=groups), there, solver=pick_solver())
        return self.readings(model)


class Cavern(Site):
    """`cases/cavern`: its truth.yaml on a mesh of quadratic elements, three later benches."""

    fitted = ("heading", "bench 1", "bench 2")
    later = ("bench 3", "bench 4", "bench 5")
    true: ClassVar[Mapping[str, float]] = {
        "E_rock": 12e9,
        "E_fault": 1.5e9,
        "sigma_v": 8.4e6,
        "K0": 1.4,
    }
    strength = (5e6, 42.0)

    @cached_property
    def truth(self) -> tuple[Case, Mesh]:
        """The case on a mesh with twice the element sizes, quadratic ones."""
        return self.read(self.meshed(2.0, order=2), RIGHT)

    @cached_property
    def model_mesh(self) -> Path:
        """The shipped one."""
        return CAVERN / "cavern.msh"

    @cached_property
    def coarse_mesh(self) -> Path:
        """With four times the element sizes, linear."""
        return self.meshed(4.0, order=1)

    @cached_property
    def places(self) -> np.ndarray:
        """The centres of a mesh with four times the element sizes."""
        return _centres(read_mesh(str(self.coarse_mesh), dim=2))

    def meshed(self, size: float, *, order: int) -> Path:
        """A mesh of the case's own script."""
        path = self.folder / f"cavern-{size:g}.msh"
        words = ["--size", str(size), "--order", str(order), "--output", str(path)]
        subprocess.run(
            [sys.executable, str(CAVERN / "make_mesh.py"), *words], check=True, capture_output=True
        )
        return path

    def faulted(self) -> np.ndarray:
        """The case has its fault zone; a model that lacks it is written without."""
        return self.homogeneous()

    def write(self, folder: Path, mesh: Path, readings: str, truth: Truth) -> Path:
        """The shipped case with another mesh and other readings, as it is modelled of a truth."""
        text = (CAVERN / "case.yaml").read_text(encoding="utf-8")
        changes = [("file: cavern.msh", f"file: {mesh}")]
        changes += [("readings: readings.csv", f"readings: {readings}")]
        if truth.fixed_k0 is not None:
            changes += [("  K0: {start: 1.0, bounds: [0.3, 3.0]}\n", "")]
            changes += [("K0: $K0", f"K0: {truth.fixed_k0}")]
        if truth.fault_unknown:
            changes += [("  E_fault: {start: 5 GPa, bounds: [0.1 GPa, 40 GPa], scale: log}\n", "")]
            changes += [("  fault:     {elastic: isotropic, E: $E_fault, nu: 0.3}\n", "")]
            changes += [("  fault: fault\n", "  fault: rock\n")]
        for old, new in changes:
            if text.count(old) != 1:
                raise ValueError(f"cases/cavern/case.yaml has not one '{old}'")
            text = text.replace(old, new)
        path = folder / "case.yaml"
        path.write_text(text, encoding="utf-8")
        return path


def _centres(mesh: Mesh) -> np.ndarray:
    return np.concatenate([mesh.points[b.nodes[:, :3]].mean(axis=1) for b in mesh.blocks])


# Truths ------------------------------------------------------------------------------------------


def _softer(rock: Material, factor: float) -> Material:
    elastic = rock.elastic
    assert isinstance(elastic, Isotropic)
    modulus = replace(elastic.E, factor=factor * elastic.E.factor)
    return replace(rock, elastic=replace(elastic, E=modulus))


def _fault(site: Site) -> np.ndarray:
    """Log E of a zone 4 m wide, dipping 75 degrees, 4 m behind the right wall at its foot."""
    x, y = site.centres.T
    distance = np.cos(np.radians(15)) * (x - 18.0) + np.sin(np.radians(15)) * (y - 12.0)
    inside = (np.abs(distance) < 2.0) & (np.abs(y - 12.0) < 40.0)
    return np.where(inside, np.log(0.1), 0.0)


def _drawn(sd: float, site: Site, generator: np.random.Generator) -> np.ndarray:
    size = np.sqrt(np.log(1.0 + sd**2))
    return size * (site.root @ generator.normal(size=len(site.places)))[site.nearest]


@dataclass(frozen=True)
class Truth:
    """How the ground differs from its model.

    Args:
        readings: (n_channels, n_stages) of one run, without noise.
        noise: in stated accuracies.
        fixed_k0: at which the model keeps K0.
        fault_unknown: the model has no fault zone.
        coarse: the model's mesh is.
        zero: error of the zero of each channel, in accuracies; readings are then daily.
        drawn: each run has its own truth.
    """

    readings: Callable[[Site, np.random.Generator], np.ndarray]
    noise: float = 1.0
    fixed_k0: float | None = None
    fault_unknown: bool = False
    coarse: bool = False
    zero: float = 0.0
    drawn: bool = False


def _plain(site: Site, generator: np.random.Generator) -> np.ndarray:
    return site.homogeneous()


RIGHT = Truth(_plain)
TRUTHS: Mapping[str, Truth] = {
    "right": RIGHT,
    "field-15": Truth(lambda s, g: s.heterogeneous(_drawn(0.15, s, g)), drawn=True),
    "field-30": Truth(lambda s, g: s.heterogeneous(_drawn(0.30, s, g)), drawn=True),
    "yielding": Truth(lambda s, g: s.yielding()),
    "accuracies": Truth(_plain, noise=3.0),
    "K0": Truth(_plain, fixed_k0=1.0),
    "fault": Truth(lambda s, g: s.faulted(), fault_unknown=True),
    "zeros": Truth(_plain, zero=ZERO),
    "coarse": Truth(_plain, coarse=True),
}


def true_readings(site: Site, name: str, run: int) -> np.ndarray:
    """Those of a run, (n_channels, n_stages); kept, so that settings meet the same truths."""
    truth = TRUTHS[name]
    same = name if truth.drawn or truth.readings is not _plain else "right"
    key = f"{same} {run if truth.drawn else 0}"
    if key not in site.kept:
        number = sorted(TRUTHS).index(name)
        site.kept[key] = truth.readings(site, np.random.default_rng([number, run, 1]))
    return np.asarray(site.kept[key])
