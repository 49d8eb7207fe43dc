"""Whether bands hold where the ground is not like its model: coverage by repetitions.

    python tests/benchmarks/wrong_models.py --runs 50
    python tests/benchmarks/wrong_models.py --runs 50 --truths right field-30 --set estimate none
    python tests/benchmarks/wrong_models.py --cavern --cavern-runs 10

A cavern in plane strain is excavated in a pilot drift, a heading and two benches. What the gauges
read up to the first bench is fitted (two parameters, ten readings; a hundred with ``--gauges
many``), the second bench is predicted with its 95 % bands. The readings come from a truth on a
finer mesh that differs from the model as its name says, with noise of the size of the accuracies.
Each run has its own noise and, where the truth is drawn, its own truth. ``--cavern`` does the same
with cases/cavern, read up to bench 2, and its three later benches.

What came of each run is kept with ``--kept FILE``: the same command goes on from there, as long as
the program is the same, so that a table can be made in pieces, or by several processes with
different truths (each with a file of its own; ``--kept`` takes several, and writes to the first).

The columns of the table, for every truth and every setting of ``fit.model_error``:

    inside             later readings in their 95 % band
    width, accuracies  median half width of these bands, in stated accuracies
    width, oracles     the same, in widths of an oracle who knows the covariance of truth less model
    error, mm          root mean square of prediction less truth without noise
    parameters         true ones inside their 95 % interval
    exit 4             runs that end so: poor fit, or not determined
    misfit             runs with a finding on a misfit or a large model error
    backtest           ... that the backtest of the last fitted stage went badly
    extrapolation      ... that later stages load the ground beyond what was tested
    silent             runs with exit 0 and none of these
    inside, silent     later readings of those runs in their band
    size               median of the estimated model error, of the computed motion

The truths:

    right        nothing differs
    field-15     Young's modulus lognormal with sd 15 %, correlated over 20 m (field-30: 30 %)
    yielding     the rock yields where it is stressed most; up to the first bench that hardly shows
    accuracies   the gauges are three times less accurate than stated
    K0           fixed at 1.0 instead of 1.6 (cases/cavern: 1.4), one parameter less
    fault        a soft zone behind the right wall that the model lacks
    zeros        20 daily readings share the error of their zero, three accuracies large
    coarse       the model is a mesh of some 200 linear triangles (cases/cavern: 870)
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import gmsh  # noqa: E402
import numpy as np  # noqa: E402
from scipy.spatial import cKDTree  # noqa: E402

import geoident  # noqa: E402
from geoident.api import fit, load_case  # noqa: E402
from geoident.fem.solvers import pick_solver  # noqa: E402
from geoident.forward.model import StagedModel, staged_model  # noqa: E402
from geoident.io.case.file import read_case  # noqa: E402
from geoident.io.mesh.file import read_mesh  # noqa: E402
from geoident.model.case import Case, Material  # noqa: E402
from geoident.model.ground import Isotropic  # noqa: E402
from geoident.model.mesh import Mesh  # noqa: E402
from geoident.model.parameter import Scalar  # noqa: E402
from geoident.model.results.result import Result  # noqa: E402
from geoident.model.yielding import MohrCoulomb  # noqa: E402

E, K0, VERTICAL, ACCURACY = 20e9, 1.6, 8e6, 0.12e-3
FLOORS = {"pilot": (20.0, 24.0, 3.0), "heading": (16.0, 24.0, 10.0)}
HALF, TOP = 10.0, 24.0
LENGTH, CLASSES = 20.0, 31
ZERO, DAYS = 3.0, 20
NORMAL95 = 1.959964
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
WORDS = {
    "misfit": (
        "times as large as the stated accuracies",
        "tell a model error",
        "explain the residuals better",
        "The model meets",
    ),
    "backtest": ("Backtest of",),
    "extrapolation": ("an elastic model has not been tested there",),
}
"""Of findings: a misfit, its size, what may be behind it; bands that did not hold; more stress."""

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


# The oracle --------------------------------------------------------------------------------------


def oracle(site: Site, name: str, truths: Sequence[int]) -> np.ndarray:
    """Half widths (m,) of the 95 % bands of one who knows how this truth differs from the model.

    Generalized least squares by linearization at the true parameters. The covariance of the
    readings is that of the noise as it is, plus the mean over the truths of d d^T with d what they
    read less what the model computes. Of a truth that is one and the same in all runs the oracle
    so knows the shape and the size of the difference, not its sign. Places that are later read are
    predicted from the others (kriging with the parameters as unknown trend).

    Args:
        site: meshes and truths.
        name: of the truth.
        truths: numbers of the runs whose truths make the covariance.

    Returns:
        Half widths at the places of `later_places`, m.
    """
    truth, case = TRUTHS[name], site.truth[0]
    mesh = site.coarse_mesh if truth.coarse else site.model_mesh
    there, of_model = site.read(mesh, truth)
    model = staged_model(of_model, there, solver=pick_solver("auto"))
    base = site.readings(model)
    used, later = read_places(site, site.fitted), read_places(site, site.later)
    rows, columns = (np.concatenate([used[k], later[k]]) for k in (0, 1))
    left = np.array([(true_readings(site, name, run) - base)[rows, columns] for run in truths])
    sd = np.array([channel.accuracy for channel in case.channels])[rows]
    days = np.where(np.arange(len(rows)) < len(used[0]), DAYS if truth.zero else 1, 1)
    covariance = left.T @ left / len(left) + np.diag((truth.noise * sd) ** 2 / days)
    covariance += (truth.zero * sd) ** 2 * (rows[:, None] == rows)
    jacobian = []
    for parameter in model.names:
        step = 1e-3 * site.true[parameter]
        up, down = (
            site.readings(model, {parameter: site.true[parameter] + s}) for s in (step, -step)
        )
        jacobian.append(((up - down) / (2 * step) * site.true[parameter])[rows, columns])
    precision = np.diag(
        [
            0.0 if p.prior is None else (site.true[p.name] / p.prior.sd) ** 2
            for p in model.case.parameters
        ]
    )
    n, slopes = len(used[0]), np.array(jacobian).T
    weights = np.linalg.solve(covariance[:n, :n], covariance[:n, n:])
    trend = slopes[n:] - weights.T @ slopes[:n]
    known = slopes[:n].T @ np.linalg.solve(covariance[:n, :n], slopes[:n]) + precision
    variance = covariance[n:, n:] - covariance[n:, :n] @ weights
    variance = variance + trend @ np.linalg.solve(known, trend.T)
    return NORMAL95 * np.sqrt(np.diag(variance))


def read_places(site: Site, stages: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Channel and stage (m,), (m,) of what is read in some stages."""
    case = site.truth[0]
    exact, names = true_readings(site, "right", 0), [s.name for s in case.stages]
    found = [
        (i, names.index(stage))
        for i, channel in enumerate(case.channels)
        for stage in stages
        if np.isfinite(exact[i, names.index(stage)]) and channel.zero != stage
    ]
    rows, columns = np.array(found).T
    return rows, columns


# Runs --------------------------------------------------------------------------------------------


def source_digest() -> str:
    """Of the program and of this suite: runs of another one are not kept."""
    found = hashlib.sha256(Path(__file__).read_bytes())
    for path in sorted(Path(geoident.__file__).parent.rglob("*.py")):
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


@dataclass(frozen=True)
class Run:
    """What came of one run.

    Args:
        inside: (m,) later readings in their band.
        width: (m,) half width of the bands, m.
        accuracy: (m,) of these readings, m.
        error: (m,) of the prediction against the truth without noise, m.
        covered: (n,) true parameters in their intervals.
        exit_code: of the fit.
        said: which kinds of `WORDS` its findings have.
        size: of the model error; 0 for none.
    """

    inside: np.ndarray
    width: np.ndarray
    accuracy: np.ndarray
    error: np.ndarray
    covered: np.ndarray
    exit_code: int
    said: frozenset[str]
    size: float

    @classmethod
    def from_text(cls, text: str) -> Run:
        """What `as_text` wrote."""
        raw = json.loads(text)
        arrays = {k: np.array(v) for k, v in raw.items() if isinstance(v, list) and k != "said"}
        return cls(**{**raw, **arrays, "said": frozenset(raw["said"])})

    def as_text(self) -> str:
        """One line of JSON."""
        raw = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(self).items()}
        return json.dumps(raw | {"said": sorted(self.said), "exit_code": int(self.exit_code)})

    @property
    def silent(self) -> bool:
        """Whether it ended with exit 0 and without any of the words."""
        return self.exit_code == 0 and not self.said


@dataclass
class Kept:
    """Runs of the same program that were made before.

    Args:
        paths: of files with a key and a run in each line; new ones go to the first.
        digest: of the program.
        runs: key to what came of it.
    """

    paths: Sequence[Path]
    digest: str = field(default_factory=source_digest)
    runs: dict[str, Run] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for path in self.paths:
            for line in path.read_text().splitlines() if path.exists() else ():
                key, _, text = line.partition("\t")
                self.runs[key] = Run.from_text(text)

    def run(self, key: str, make: Callable[[], Run]) -> Run:
        """A run, made if it was not made before.

        Args:
            key: of site, truth, setting and number.
            make: makes it.
        """
        key = f"{self.digest} {key}"
        if key not in self.runs:
            self.runs[key] = make()
            if self.paths:
                with self.paths[0].open("a") as file:
                    file.write(f"{key}\t{self.runs[key].as_text()}\n")
        return self.runs[key]


def one_run(site: Site, name: str, run: int, setting: str, folder: Path) -> Run:
    """Draw readings, fit, compare.

    Args:
        site: meshes and truths.
        name: of the truth.
        run: its number.
        setting: of ``fit.model_error``; empty to leave it out.
        folder: for the files of the run.
    """
    truth = TRUTHS[name]
    exact = true_readings(site, name, run)
    generator = np.random.default_rng([run, 2])
    channels, stages = site.truth[0].channels, [s.name for s in site.truth[0].stages]
    sd = np.array([channel.accuracy for channel in channels])
    noisy = exact + truth.noise * sd[:, None] * generator.normal(size=exact.shape)
    offset = truth.zero * sd * generator.normal(size=len(exact))
    lines = ["gauge,stage,value,unit"]
    for i, j in zip(*read_places(site, site.fitted), strict=True):
        days = DAYS if truth.zero else 1
        values = exact[i, j] + offset[i] + sd[i] * generator.normal(size=days)
        values = values if truth.zero else noisy[i, j : j + 1]
        lines += [f"{channels[i].name},{stages[j]},{1e3 * v!r},mm" for v in values.tolist()]
    (folder / "readings.csv").write_text("\n".join(lines) + "\n")
    mesh = site.coarse_mesh if truth.coarse else site.model_mesh
    file = "{file: readings.csv, several: all}" if truth.zero else "readings.csv"
    path = site.write(folder, mesh, file, truth)
    overrides: dict[str, object] = {"fit.model_error": setting} if setting else {}
    found = fit(load_case(path, overrides), output=folder / "found.h5", force=True, fresh=True)
    return _judged(site, found.data, exact, noisy + offset[:, None])


def _judged(site: Site, result: Result, exact: np.ndarray, later: np.ndarray) -> Run:
    assert result.prediction is not None
    assert result.gauges.stages == tuple(s.name for s in site.truth[0].stages)
    there = read_places(site, site.later)
    mean, lower, upper = (
        getattr(result.prediction, part)[there] for part in ("mean", "lower95", "upper95")
    )
    table = result.parameters
    true = np.array([site.true[name] for name in table.names])
    found = result.model_error
    said = {
        kind
        for kind, words in WORDS.items()
        if any(word in text for text in result.findings for word in words)
    }
    return Run(
        (later[there] >= lower) & (later[there] <= upper),
        0.5 * (upper - lower),
        np.array([channel.accuracy for channel in site.truth[0].channels])[there[0]],
        mean - exact[there],
        (true >= table.lower95) & (true <= table.upper95),
        result.exit_code,
        frozenset(said),
        0.0 if found is None else float(found.size),
    )


# Tables ------------------------------------------------------------------------------------------

COLUMNS = (
    "truth", "model error", "runs", "inside", "width, accuracies", "width, oracles", "error, mm",
    "parameters", "exit 4", "misfit", "backtest", "extrapolation", "silent", "inside, silent",
    "size",
)  # fmt: skip


def cells(name: str, setting: str, runs: Sequence[Run], known: np.ndarray | None) -> list[str]:
    """One row of the table, one text for each of `COLUMNS`.

    Args:
        name: of the truth.
        setting: of the model error.
        runs: what came of them.
        known: (m,) half widths of the oracle's bands, m; None where there is none.
    """
    silent = [run for run in runs if run.silent]
    error = np.sqrt(np.mean(np.concatenate([run.error for run in runs]) ** 2))
    against = "-"
    if known is not None:
        against = f"{np.median([np.median(run.width / known) for run in runs]):.2f}"
    return [
        name,
        setting or "default",
        str(len(runs)),
        _percent([run.inside for run in runs]),
        f"{np.median([np.median(run.width / run.accuracy) for run in runs]):.2f}",
        against,
        f"{1e3 * error:.2f}",
        _percent([run.covered for run in runs]),
        str(sum(run.exit_code != 0 for run in runs)),
        *(str(sum(kind in run.said for run in runs)) for kind in WORDS),
        str(len(silent)),
        _percent([run.inside for run in silent]),
        f"{100 * np.median([run.size for run in runs]):.0f} %",
    ]


def _percent(flags: Sequence[np.ndarray]) -> str:
    return f"{100 * np.concatenate(flags).mean():.0f} %" if flags else "-"


def all_rows(
    site: Site,
    names: Sequence[str],
    settings: Sequence[str],
    count: int,
    *,
    seed: int,
    truths: int,
    kept: Kept,
) -> Iterator[list[str]]:
    """Rows of the table.

    Args:
        site: meshes and truths.
        names: of the truths.
        settings: of the model error.
        count: runs of each.
        seed: number of the first run.
        truths: drawn for the covariance of the oracle; 0 for no oracle.
        kept: runs that were made before.
    """
    where = f"{type(site).__name__} {'many' if site.many else 'few'}"
    for name in names:
        known = None
        if truths:
            drawn = truths if TRUTHS[name].drawn else 1
            known = oracle(site, name, range(seed, seed + drawn))
        for setting in settings:
            numbers = range(seed, seed + count)
            runs = [
                kept.run(
                    f"{where} {name} {setting} {run}",
                    partial(one_run, site, name, run, setting, site.folder),
                )
                for run in numbers
            ]
            yield cells(name, setting, runs, known)


def tables(given: argparse.Namespace, *, cavern: bool) -> Iterator[str]:
    """Lines of the table in markdown.

    Args:
        given: options of `options`.
        cavern: of cases/cavern.
    """
    yield f"| {' | '.join(COLUMNS)} |"
    yield "|---" * len(COLUMNS) + "|"
    with tempfile.TemporaryDirectory() as folder:
        many = given.gauges == "many"
        site = Cavern(Path(folder)) if cavern else Site(Path(folder), many)
        truths = 0 if many else given.cavern_oracle if cavern else given.oracle
        count = given.cavern_runs if cavern else given.runs
        kept = Kept([Path(path) for path in given.kept])
        rows = all_rows(
            site, given.truths, given.settings, count, seed=given.seed, truths=truths, kept=kept
        )
        for row in rows:
            yield f"| {' | '.join(row)} |"


def options(parser: argparse.ArgumentParser) -> None:
    """Add what the tables can be told."""
    parser.add_argument("--runs", type=int, default=50, help="of each row")
    parser.add_argument("--cavern-runs", type=int, default=10, help="of each row of cases/cavern")
    parser.add_argument("--truths", nargs="+", choices=list(TRUTHS), default=list(TRUTHS))
    parser.add_argument("--set", nargs="+", default=["estimate", "none"], dest="settings")
    parser.add_argument("--gauges", choices=("few", "many"), default="few")
    parser.add_argument("--oracle", type=int, default=100, help="truths drawn for it; 0: without")
    parser.add_argument("--cavern-oracle", type=int, default=20, help="the same of cases/cavern")
    parser.add_argument("--kept", nargs="+", default=[], help="files of runs, to go on from")
    parser.add_argument("--seed", type=int, default=0, help="number of the first run")


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options(parser)
    parser.add_argument("--cavern", action="store_true", help="cases/cavern")
    given = parser.parse_args(arguments)
    for line in tables(given, cavern=given.cavern):
        print(line, flush=True)


if __name__ == "__main__":
    main()
