from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.parameter import Prior
from geoident.model.results.bands import Prediction
from geoident.model.results.costs import Counts
from geoident.model.results.findings import Finding
from geoident.model.results.opening import FaceAdvance, GroundReaction
from geoident.model.results.reduced import FORM, KeptReducedModel
from geoident.model.results.result import (
    Diagnostics,
    FieldSeries,
    GaugeTable,
    Grid,
    Iteration,
    ParameterTable,
    Provenance,
    Result,
)
from geoident.model.results.yielded import Mechanism, YieldedGround
from tests.support.results import wide_gauges

CHANNELS = ("EX1.a5", "EX1.a15", "CV1")
STAGES = ("heading", "bench 1")
NAMES = ("E_rock", "sigma_v")
SOLIDS = tuple(kind for kind, cell in CELLS.items() if cell.usable and cell.dim == 3)


def block(kind: str, *rows: tuple[int, ...], first: int = 1) -> ElementBlock:
    nodes = np.array(rows, dtype=np.int64)
    return ElementBlock(kind, nodes, np.arange(first, first + len(rows), dtype=np.int64))


def plane_mesh() -> Mesh:
    """Two triangles, a quadrilateral, and quadratic ones beside them, sharing nodes."""
    x, y = np.meshgrid(np.arange(5.0), np.arange(3.0))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    return Mesh(
        points=points,
        blocks=(
            block("tri3", (0, 1, 5), (1, 6, 5), first=11),
            block("quad4", (5, 6, 11, 10), first=101),
            block("tri6", (2, 4, 12, 3, 8, 7)),
            block("quad8", (0, 2, 12, 10, 1, 7, 11, 5), first=7),
        ),
        facets=(block("line2", (0, 1), (1, 2)), block("line3", (2, 4, 3), first=3)),
        groups={"rock": np.array([0, 1, 3, 4]), "heading/ä": np.array([2])},
        facet_groups={"bottom": np.array([0, 1, 2])},
        node_groups={"corner": np.array([0]), "none": np.array([], dtype=np.int64)},
        file="cavern.msh",
    )


def solid_mesh() -> Mesh:
    """One element of every solid kind on the nodes of a 3 x 3 x 3 lattice."""
    grid = np.array([(i, j, k) for k in range(3) for j in range(3) for i in range(3)], dtype=float)
    number = {tuple(p): n for n, p in enumerate(grid.astype(int).tolist())}
    base, top = (
        [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)],
        [(0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)],
    )
    corners = {
        "tet": [base[0], base[1], base[3], top[0]],
        "hex": base + top,
        "wedge": [base[0], base[1], base[3], top[0], top[1], top[3]],
        "pyramid": [*base, top[0]],
    }

    def nodes(kind: str) -> tuple[int, ...]:
        points = corners[CELLS[kind].shape.name]
        middles = [np.mean([points[a], points[b]], axis=0) for a, b in CELLS[kind].edges]
        return tuple(number[int(x), int(y), int(z)] for x, y, z in [*points, *middles])

    return Mesh(
        points=grid,
        blocks=tuple(block(kind, nodes(kind)) for kind in SOLIDS),
        groups={"rock": np.arange(len(SOLIDS))},
    )


def make_fields(mesh: Mesh, states: int = 3) -> FieldSeries:
    rng = np.random.default_rng(7)
    present = np.ones((states, mesh.n_elements), dtype=bool)
    present[1:, 2] = False
    present[2, 0] = False
    stress = rng.normal(size=(states, mesh.n_elements, 6)) * 1e6
    stress[~present] = np.nan
    displacement = rng.normal(size=(states, mesh.n_nodes, mesh.dim)) * 1e-3
    displacement[0] = 0.0
    yielded = rng.random((states, mesh.n_elements)) < 0.5
    return FieldSeries(mesh, displacement, stress, present, yielded)


def make_parameters() -> ParameterTable:
    return ParameterTable(
        names=NAMES,
        values=np.array([1.5e10, 8.1e6]),
        sd=np.array([2e8, np.nan]),
        lower95=np.array([1.46e10, np.nan]),
        upper95=np.array([1.54e10, np.nan]),
        lower=np.array([2e9, 2e6]),
        upper=np.array([8e10, np.inf]),
        start=np.array([1.4e10, 8e6]),
        at_bound=np.array([False, True]),
        determined=np.array([True, False]),
        priors=(None, Prior(8e6, 1e6)),
        units=("GPa", "MPa"),
        dimensions=("pressure", "pressure"),
        covariance=np.array([[4e16, np.nan], [np.nan, np.nan]]),
        correlation=np.array([[1.0, np.nan], [np.nan, np.nan]]),
    )


def make_gauges(dim: int) -> GaugeTable:
    rng = np.random.default_rng(3)
    shape = (len(CHANNELS), len(STAGES))
    measured = rng.normal(size=shape) * 1e-3
    measured[2, 0] = np.nan
    first = rng.normal(size=(shape[0], dim))
    first[1] = np.nan
    return wide_gauges(
        channels=CHANNELS,
        stages=STAGES,
        measured=measured,
        computed=measured + 1e-5,
        sd=np.full(shape, 1e-4),
        used=np.isfinite(measured),
        first=first,
        second=rng.normal(size=(shape[0], dim)),
    )


def make_diagnostics(k: int) -> Diagnostics:
    rng = np.random.default_rng(5)
    tables = [rng.normal(size=k) for _ in range(5)]
    tables[1][0] = np.nan
    influence = rng.normal(size=(k, 2))
    influence[0, 1] = np.inf
    return Diagnostics("huber (delta 1.345)", 12.5, 1.25, *tables, influence)


PROVENANCE = Provenance(
    command="geoident fit cavern.yaml --seed 4",
    versions={"geoident": "0.1.0", "numpy": "2.1"},
    seed=4,
    case_file="cavern.yaml",
    case_sha256="a" * 64,
    mesh_sha256="b" * 64,
    readings_sha256="c" * 64,
    identity="d" * 64,
    created="2025-01-02T03:04:05+00:00",
)


def make_reaction() -> GroundReaction:
    """An opening that yields from the second pressure on, and two stages."""
    return GroundReaction(
        centre=np.array([1.0, -2.0]),
        radius=2.5,
        in_situ=np.array([1e7, 1.2e7, 1.1e7, 0.0]),
        critical=5e6,
        pressure=np.array([1.1e7, 4e6, 0.0]),
        displacement=np.array([0.0, 2e-3, 9e-3]),
        plastic_radius=np.array([np.nan, 2.8, 4.5]),
        stages=("face", "far on"),
        stage_pressure=np.array([6e6, 0.0]),
        stage_displacement=np.array([1e-3, 9e-3]),
        stage_plastic_radius=np.array([np.nan, 4.5]),
        radii=np.array([2.5, 5.0, 10.0]),
        radial=np.array([[6e6, 8e6, 1e7], [0.0, 5e6, 9e6]]),
        hoop=np.array([[1.6e7, 1.3e7, 1.1e7], [2e6, 1.8e7, 1.3e7]]),
        supports=("bolts", "ring"),
        support_pressure=np.array([[np.nan, 8e4], [np.nan, 5e5]]),
        support_capacity=np.array([[np.nan, 8e4], [np.nan, np.inf]]),
    )


def make_advance() -> FaceAdvance:
    """A face that passes: two stages, gauges zeroed at the first."""
    return FaceAdvance(
        law="panet",
        radius=2.5,
        distance=np.array([0.0, 2.0, 8.0]),
        share=np.array([0.25, 0.825, 0.9773]),
        stages=("first reading", "far on"),
        stage_distance=np.array([2.0, 8.0]),
        stage_share=np.array([0.825, 0.9773]),
        stage_released=np.array([0.9, 0.99]),
        stage_zero=np.array([True, False]),
    )


def make_reduced() -> KeptReducedModel:
    """Arrays of every number of axes, an empty one among them."""
    return KeptReducedModel(
        form=FORM,
        names=NAMES,
        reference=np.array([1.5e10, 8e6]),
        lower=np.array([2e9, 2e6]),
        upper=np.array([8e10, 2e7]),
        analyses=np.array([[1.5e10, 8e6], [1.4e10, 8.5e6], [2e10, 7e6]]),
        materials=("rock", "Beton"),
        channels=CHANNELS,
        weights=np.array([[1.0, 1.0, 1.0], [-1.0, -1.0, 0.0]]),
        zero=np.array([0, 1, 0]),
        readable=np.array([[False] * 3, [True, False, True], [True] * 3]),
        built_on=np.triu(np.ones((3, 3), dtype=bool)),
        rows=np.array([0, 1, 1]),
        states=np.array([1, 1, 2]),
        blocks={
            "one": np.arange(3.0),
            "none": np.zeros((2, 0, 3)),
            "two 0 rock": np.arange(4.0).reshape(2, 2),
            "number": np.array(7.0),
            "four": np.arange(24.0).reshape(2, 3, 2, 2),
        },
    )


def make_result(dim: int = 2, *, full: bool = True) -> Result:
    gauges = make_gauges(dim)
    shape = gauges.measured.shape
    counts = Counts(3, 1, 6, 18)
    small = Result(
        kind="fit",
        status="converged",
        exit_code=0,
        method="gauss-newton",
        reason="The step became small.",
        objective=3.25,
        findings=(),
        case_text="format: geoident-case/1\ntitle: Höhle\n",
        case_resolved="format: geoident-case/1\ntitle: Höhle\nfit: {}\n",
        provenance=PROVENANCE,
        parameters=make_parameters(),
        gauges=gauges,
        counts=counts,
    )
    if not full:
        return small
    band = np.linspace(0.0, 1.0, gauges.measured.size).reshape(shape)
    return dataclasses.replace(
        small,
        findings=(
            Finding("not-determined", "E höher", "E höher: not determined."),
            Finding("correlated", "E höher, K0", "Strongly correlated.", {"correlation": -0.97}),
        ),
        notes=("A note.", ""),
        sensitivity=np.arange(float(np.prod(shape) * 2)).reshape(*shape, 2),
        prediction=Prediction(band, band + 1, band - 2, band + 2),
        history=tuple(
            Iteration(
                "gauss-newton", i, 10.0 / (i + 1), np.array([1e10 + i, 8e6]), 0.5, counts, "x"
            )
            for i in range(3)
        ),
        grid=Grid(
            NAMES,
            (np.array([1e10, 2e10, 3e10]), np.array([8e6, 9e6])),
            np.array([[1.0, 2.0], [3.0, np.inf], [5.0, 6.0]]),
        ),
        reaction=make_reaction(),
        advance=make_advance(),
        yielded=make_yielded(dim),
        mechanism=make_mechanism(plane_mesh() if dim == 2 else solid_mesh()),
        reduced=make_reduced(),
        fields=make_fields(plane_mesh() if dim == 2 else solid_mesh()),
        singular_values=np.array([3.0, 1e-9]),
        diagnostics=make_diagnostics(len(gauges.readings)),
    )


def make_yielded(dim: int) -> YieldedGround:
    """Nothing yields in the first of three states."""
    size = np.array([0.0, 1.5, 2.5])
    reach = np.array([np.nan, 0.5, 0.75])
    ends = np.arange(3.0 * dim).reshape(3, dim)
    unit = "m2" if dim == 2 else "m3"
    return YieldedGround(
        ("virgin", *STAGES), size, size / 10, reach, reach + 1, ends, ends + 1, unit
    )


def make_mechanism(mesh: Mesh) -> Mechanism:
    """Some elements are gone."""
    size = np.linspace(0.0, 1.0, mesh.n_elements)
    velocity = np.linspace(-1.0, 1.0, mesh.points.size).reshape(mesh.points.shape)
    return Mechanism("bench 1", 2, 0.75, mesh, size > 0.2, velocity, size)


@pytest.fixture
def result_maker() -> Callable[..., Result]:
    return make_result
