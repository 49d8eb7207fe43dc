"""Results put together in code: a plane and a solid ground with a hole dug in stages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.model.gauges import ReadingTable
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.parameter import Prior
from geoident.model.results.bands import Prediction
from geoident.model.results.costs import Counts
from geoident.model.results.findings import Finding
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

STAGES = ("drift", "bench 1", "bench 2")
NAMES = ("E_rock", "sigma_v", "K0")
CHANNELS = ("EX-1.a2", "EX-1.a4", "EX-1.a8", "CV-1", "ST-1")


def grid_mesh(dim: int, n: int = 10, *, size: float = 20.0) -> Mesh:
    """A square or cube of quads or hexes, the middle of its top in two groups to be dug."""
    line = np.linspace(0.0, size, n + 1)
    axes = np.meshgrid(*[line] * dim, indexing="ij")
    points = np.stack([a.ravel() for a in axes], axis=1)
    number = np.arange((n + 1) ** dim).reshape((n + 1,) * dim)
    corner = [(0, 0), (1, 0), (1, 1), (0, 1)]
    if dim == 3:
        corner = [(*c, k) for k in (0, 1) for c in corner]
    nodes = np.stack(
        [number[tuple(slice(c, n + c) for c in place)].ravel() for place in corner], axis=1
    )
    centre = points[nodes].mean(axis=1) / size
    inside = (np.abs(centre[:, :-1] - 0.5) < 0.2).all(axis=1)
    upper, lower = inside & (centre[:, -1] > 0.8), inside & (np.abs(centre[:, -1] - 0.7) < 0.1)
    groups = {
        "rock": np.flatnonzero(~(upper | lower)),
        "upper": np.flatnonzero(upper),
        "lower": np.flatnonzero(lower),
    }
    block = ElementBlock("quad4" if dim == 2 else "hex8", nodes, np.arange(1, len(nodes) + 1))
    return Mesh(points, (block,), groups=groups)


def fields_of(mesh: Mesh, *, yielded: bool = False) -> FieldSeries:
    """Ground that closes towards the hole as stages go, under its own weight."""
    present = np.ones((4, mesh.n_elements), dtype=bool)
    present[1:, mesh.groups["upper"]] = False
    present[3:, mesh.groups["lower"]] = False
    from_hole = np.full(mesh.dim, 10.0)
    from_hole[-1] = 16.0
    away = mesh.points - from_hole
    closing = -away / (1.0 + (away**2).sum(axis=1, keepdims=True))
    displacement = np.array([0.0, 4e-3, 7e-3, 12e-3])[:, None, None] * closing
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    vertical = -25e3 * (21.0 - centre[:, -1])
    normal = np.stack([0.5 * vertical, vertical if mesh.dim == 2 else 0.5 * vertical, vertical])
    stress = np.zeros((4, mesh.n_elements, 6))
    stress[:, :, :3] = normal.T
    stress[:, :, 3] = 0.1 * vertical
    stress[~present] = np.nan
    flags = np.zeros_like(present)
    if yielded:
        flags[2:, ::7] = True
    return FieldSeries(mesh, displacement, stress, present, flags & present)


def parameters() -> ParameterTable:
    """One known, one at its bound, one that only its prior knows."""
    nan = np.nan
    return ParameterTable(
        names=NAMES,
        values=np.array([1.234e10, 6.5432e6, 3.0]),
        sd=np.array([4e8, nan, 0.1]),
        lower95=np.array([1.16e10, nan, 2.8]),
        upper95=np.array([1.31e10, nan, 3.0]),
        lower=np.array([2e9, 2e6, 0.3]),
        upper=np.array([8e10, 2e7, 3.0]),
        start=np.array([2e10, 8e6, 1.0]),
        at_bound=np.array([False, False, True]),
        determined=np.array([True, False, True]),
        priors=(Prior(1.4e10, 2.5e9, "lognormal"), Prior(8e6, 8e5), None),
        units=("GPa", "MPa", ""),
        dimensions=("pressure", "pressure", "dimensionless"),
        covariance=np.diag([1.6e17, nan, 1e-2]),
        correlation=np.array([[1.0, nan, -0.8], [nan, nan, nan], [-0.8, nan, 1.0]]),
    )


def long_table(
    channels, stages, measured, *, sd, used, bad, computed, sensitivity=None
) -> ReadingTable:
    """The k readings of a wide table, stage by stage: one a channel and stage, times unknown."""
    places = np.argwhere(np.isfinite(measured).T)[:, ::-1]
    at = tuple(places.T)
    names = tuple(channels[i] for i in places[:, 0])
    return ReadingTable(
        channel=names,
        gauge=tuple(name.partition(".")[0] for name in names),
        stage=tuple(stages[j] for j in places[:, 1]),
        time=np.full(len(places), np.nan),
        value=measured[at],
        sd=sd[at],
        used=used[at],
        bad=bad[at],
        reason=tuple(
            "" if u else "flagged as bad: see the notes" if b else "see the notes"
            for u, b in zip(used[at], bad[at], strict=True)
        ),
        computed=computed[at],
        sensitivity=None if sensitivity is None else sensitivity[at],
    )


def wide_gauges(
    channels, stages, measured, computed, *, sd, used, first, second, bad=None, more=None
) -> GaugeTable:
    """Gauges with one reading for every number in a wide table."""
    bad = np.zeros(measured.shape, dtype=bool) if bad is None else bad
    flags = {"used": used, "bad": bad}
    about = {
        "gauges": tuple(name.partition(".")[0] for name in channels),
        "dimensions": ("length",) * len(channels),
        "units": ("mm",) * len(channels),
        "accuracy": np.full(len(channels), 1e-4),
    }
    table = long_table(channels, stages, measured, sd=sd, computed=computed, **flags)
    return GaugeTable(channels, stages, computed, first, second, table, **{**about, **(more or {})})


_COLUMNS = {"measured": "value", "sd": "sd", "used": "used", "bad": "bad", "computed": "computed"}


def changed_gauges(table: GaugeTable, **changes) -> GaugeTable:
    """The same with other wide arrays or names; of one reading for every number.

    Readings keep their rows: one whose number becomes NaN is a blank one.
    """
    if changes.keys() <= _COLUMNS.keys():
        places = [table.place(k) for k in range(len(table.readings))]
        at = tuple(np.array(places).T)
        columns = {_COLUMNS[name]: array[at] for name, array in changes.items()}
        computed = changes.get("computed", table.computed)
        return replace(table, readings=replace(table.readings, **columns), computed=computed)
    names = ("channels", "stages", "measured", "computed", "sd", "used", "first", "second", "bad")
    return wide_gauges(**{name: changes.get(name, getattr(table, name)) for name in names})


def gauges(dim: int) -> GaugeTable:
    """Three anchors of an extensometer, a convergence, a settlement; one reading is off."""
    back = (10.0,) * (dim - 2)

    def at(x: float, z: float) -> tuple[float, ...]:
        return (x, *back, z)

    computed = 1e-3 * np.array(
        [[0, 0.4, 0.8], [0, 0.7, 1.5], [0, 1.1, 2.4], [0, -4, -9], [1, 2, 3.5]], dtype=float
    )
    noise = 1e-4 * np.array(
        [[0, 1, -1], [0, -1, 1], [0, 8, 1], [0, 2, -1], [-1, 1, 0]], dtype=float
    )
    measured = computed + noise
    measured[:4, 0] = np.nan
    sd = np.where(np.isfinite(measured), 1e-4, np.nan)
    used = np.isfinite(measured)
    used[:, 2] = False
    nowhere = (np.nan,) * dim
    return wide_gauges(
        channels=CHANNELS,
        stages=STAGES,
        measured=measured,
        computed=computed,
        sd=sd,
        used=used,
        first=np.array([at(14, 16), at(14, 16), at(14, 16), at(6, 18), nowhere]),
        second=np.array([at(16, 16), at(17, 16), at(19, 16), at(14, 18), at(4, 20)]),
    )


def diagnostics(table: GaugeTable) -> Diagnostics:
    """The reading that is off is the most influential."""
    readings = table.readings
    used = readings.used
    residual = np.where(used, (readings.value - readings.computed) / 1e-4, np.nan)
    share = np.where(used, 0.5, np.nan)
    change = np.where(used[:, None], 0.1 * residual[:, None] * [1.0, 0.0, 0.5], np.nan)
    return Diagnostics("huber (delta 1.345)", 75.0, 1.4826, residual, residual, share, share,
                       residual**2, change)  # fmt: skip


def history() -> tuple[Iteration, ...]:
    """A search of four trials, one rejected."""
    trials = [(900.0, "start", 2e10), (950.0, "rejected", 9e9), (40.0, "accepted", 1.3e10),
              (12.5, "accepted", 1.234e10)]  # fmt: skip
    return tuple(
        Iteration("gauss-newton", k, phi, np.array([E, 6.5e6, 2.9]), 0.3, Counts(k, 1, k, k), note)
        for k, (phi, note, E) in enumerate(trials)
    )


def example_result(dim: int = 2, *, yielded: bool = False, title: str = "Trial pit") -> Result:
    """A fit of the ground, with everything that a result can hold."""
    table = gauges(dim)
    mean = np.where(np.arange(3) == 2, table.computed, np.nan)
    sd = np.where(np.isfinite(mean), 1.5e-4, np.nan)
    sd[4, 2] = np.inf  # the settlement is predicted without being determined
    return Result(
        kind="fit",
        status="not-determined",
        exit_code=4,
        method="gauss-newton",
        reason="The next step would lower the misfit by no more than 1e-07.",
        objective=12.5,
        findings=(
            Finding(
                "only-prior", "sigma_v",
                "The readings do not determine sigma_v: it is known only from its prior.",
            ),
        ),
        case_text=f"title: {title}\n",
        case_resolved=f"title: {title}\n",
        provenance=Provenance(
            "fit case.yaml", {"geoident": "0.1.0"}, 7, "case.yaml", "a" * 64, "b" * 64, "c" * 64,
            "d" * 64, "2026-01-02T03:04:05+00:00",
        ),
        parameters=parameters(),
        gauges=table,
        counts=Counts(5, 1, 12, 40),
        prediction=Prediction(mean, sd, mean - 1.96 * sd, mean + 1.96 * sd),
        history=history(),
        fields=fields_of(grid_mesh(dim, 10 if dim == 2 else 5), yielded=yielded),
        notes=("One reading was blank.",),
        diagnostics=diagnostics(table),
    )  # fmt: skip


def small_result(**changes: object) -> Result:
    """A scan over two parameters with the readings of one gauge: few figures, quickly drawn."""
    values = np.array([[9.0, 4.0, 5.0], [6.0, 2.0, np.inf]])
    grid = Grid(("E_rock", "K0"), (np.array([1e10, 2e10]), np.array([0.5, 1.0, 2.0])), values)
    table = gauges(2)
    arrays = ("measured", "computed", "sd", "used", "first", "second", "bad")
    one = changed_gauges(table, channels=("CV-1",), **{k: getattr(table, k)[3:4] for k in arrays})
    few = replace(
        example_result(), kind="scan", status="done", fields=None, prediction=None, history=(),
        grid=grid, gauges=one, diagnostics=None,
    )  # fmt: skip
    return replace(few, **changes)
