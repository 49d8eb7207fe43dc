"""The tables of a result file, each written and read side by side.

Axes carry names: ``gauge`` (a channel), ``stage``, ``parameter``, ``iteration``; all values in SI.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter, plain_text, texts
from geoident.io.result.reading_tables import reading_unit
from geoident.model.arrays import Floats, Ints
from geoident.model.mesh import Mesh
from geoident.model.parameter import Prior
from geoident.model.results.bands import Prediction
from geoident.model.results.costs import Counts
from geoident.model.results.model_error import ModelErrorTable
from geoident.model.results.result import (
    GaugeTable,
    Grid,
    Iteration,
    MemberForces,
    ParameterTable,
    SupportReactions,
)
from geoident.model.results.yielded import Mechanism, YieldedGround
from geoident.model.yielding import Activity, Certificate
from geoident.units import DIMENSIONS

COUNTS = tuple(entry.name for entry in fields(Counts))

NEWER_COUNTS = {"iterations": 0}
"""Counts that older files lack, and what they are there."""
_PARAMETER_ARRAYS = {"value": "values"} | {name: name for name in ("sd", "lower", "upper", "start")}
_PREDICTION_ARRAYS = ("mean", "sd", "lower95", "upper95")
_CERTIFICATE_NUMBERS = ("gradient", "bound", "gap")
_PRIOR_TEXT = re.compile(r"(\w+)\((\S+), (\S+)\)")


def write_parameters(file: h5py.File, table: ParameterTable, singular: Floats | None) -> None:
    """Writes ``/parameters``.

    ``unit`` is the SI unit in which the values stand, ``display_unit`` the one that the user wrote.

    Args:
        file: the result.
        table: the parameters.
        singular: (k,) singular values of the information matrix, or None.
    """
    axes: dict[str, Sequence[str] | Floats] = {
        "parameter": table.names,
        "other": table.names,
        "bound": ("lower", "upper"),
    }
    if singular is not None:
        axes["direction"] = np.arange(len(singular), dtype=np.float64)
    out = TableWriter(file, "parameters", axes)
    for name, field in _PARAMETER_ARRAYS.items():
        out.add(name, getattr(table, field), "parameter")
    out.add("ci95", np.stack([table.lower95, table.upper95], axis=1), "parameter", "bound")
    out.add("at_bound", table.at_bound, "parameter")
    out.add("determined", table.determined, "parameter")
    out.add("name", table.names, "parameter")
    out.add("prior", ["" if q is None else str(q) for q in table.priors], "parameter")
    out.add("prior_kind", ["" if q is None else q.kind for q in table.priors], "parameter")
    out.add("prior_mean", _of_priors(table.priors, "mean"), "parameter")
    out.add("prior_sd", _of_priors(table.priors, "sd"), "parameter")
    out.add("unit", [DIMENSIONS.get(name, "") for name in table.dimensions], "parameter")
    out.add("display_unit", table.units, "parameter")
    out.add("dimension", table.dimensions, "parameter")
    if table.fields:
        out.add("field", table.fields, "parameter")
    out.add("covariance", table.covariance, "parameter", "other")
    out.add("correlation", table.correlation, "parameter", "other")
    if singular is not None:
        out.add("singular_values", singular, "direction")


def _of_priors(priors: Sequence[Prior | None], name: str) -> Floats:
    """A number (n,) of each prior, NaN where there is none."""
    numbers = [np.nan if prior is None else getattr(prior, name) for prior in priors]
    return np.array(numbers, dtype=np.float64)


def read_parameters(file: h5py.File) -> tuple[ParameterTable, Floats | None]:
    """The table, and the singular values (k,) or None.

    Raises:
        ValueError: a value is no finite number.
    """
    group = TableReader(file, "parameters")
    names = group.texts("name")
    n = len(names)
    arrays = {field: group.floats(name, n) for name, field in _PARAMETER_ARRAYS.items()}
    interval = group.floats("ci95", n, 2)
    table = ParameterTable(
        names=names,
        **arrays,
        lower95=interval[:, 0].copy(),
        upper95=interval[:, 1].copy(),
        at_bound=group.bools("at_bound", n),
        determined=group.bools("determined", n),
        priors=_read_priors(group, n),
        units=group.texts("display_unit", n),
        dimensions=group.texts("dimension", n),
        covariance=group.floats("covariance", n, n),
        correlation=group.floats("correlation", n, n),
        fields=group.texts("field", n) if "field" in group else (),
    )
    if not np.all(np.isfinite(table.values)):
        lost = names[int(np.flatnonzero(~np.isfinite(table.values))[0])]
        raise ValueError(f"the value of the parameter {lost!r} is not a finite number")
    if "singular_values" not in group:
        return table, None
    return table, group.floats("singular_values", len(group.array("direction", "f")))


def _read_priors(group: TableReader, n: int) -> tuple[Prior | None, ...]:
    """The n priors; in a file of format 1 they are texts with six digits."""
    if "prior_kind" not in group:
        return tuple(_parsed(text) for text in group.texts("prior", n))
    columns = (group.floats("prior_mean", n), group.floats("prior_sd", n))
    rows = zip(group.texts("prior_kind", n), *(c.tolist() for c in columns), strict=True)
    return tuple(_prior(kind, mean, sd) for kind, mean, sd in rows)


def _parsed(text: str) -> Prior | None:
    match = _PRIOR_TEXT.fullmatch(text)
    return None if match is None else _prior(match[1], float(match[2]), float(match[3]))


def _prior(kind: str, mean: float, sd: float) -> Prior | None:
    if not kind:
        return None
    return Prior(mean, sd, "lognormal" if kind == "lognormal" else "normal")


def write_sensitivity(
    file: h5py.File, sensitivity: Floats, gauges: GaugeTable, names: tuple[str, ...]
) -> None:
    """Writes ``/sensitivity``.

    Args:
        file: the result.
        sensitivity: (n_channels, n_stages, n) derivatives, SI per SI unit of the parameter.
        gauges: channels and stages.
        names: of the n parameters.
    """
    axes = {"gauge": gauges.channels, "stage": gauges.stages, "parameter": names}
    out = TableWriter(file, "sensitivity", axes)
    unit = f"{reading_unit(gauges)} per SI unit of the parameter"
    out.add("sensitivity", sensitivity, "gauge", "stage", "parameter", unit=unit)


def read_sensitivity(file: h5py.File, n: int) -> Floats:
    """Derivatives of the computed readings, (n_channels, n_stages, n)."""
    group = TableReader(file, "sensitivity")
    shape = len(group.texts("gauge")), len(group.texts("stage")), n
    return group.floats("sensitivity", *shape)


def write_prediction(file: h5py.File, prediction: Prediction, gauges: GaugeTable) -> None:
    """Writes ``/prediction``, SI.

    Args:
        file: the result.
        prediction: what to write.
        gauges: channels and stages.
    """
    axes = {"gauge": gauges.channels, "stage": gauges.stages}
    out = TableWriter(file, "prediction", axes)
    for name in _PREDICTION_ARRAYS:
        out.add(name, getattr(prediction, name), "gauge", "stage", unit=reading_unit(gauges))


def read_prediction(file: h5py.File, gauges: GaugeTable) -> Prediction:
    """What the gauges will show."""
    group = TableReader(file, "prediction")
    shape = gauges.computed.shape
    return Prediction(**{name: group.floats(name, *shape) for name in _PREDICTION_ARRAYS})


def write_history(file: h5py.File, history: tuple[Iteration, ...], names: tuple[str, ...]) -> None:
    """Writes ``/history``, one row an iteration.

    Args:
        file: the result.
        history: what to write.
        names: of the n parameters.
    """
    rows = np.arange(len(history), dtype=np.int64)
    out = TableWriter(file, "history", {"iteration": rows, "parameter": names})
    out.add("method", [row.method for row in history], "iteration")
    out.add("number", np.array([row.number for row in history], dtype=np.int64), "iteration")
    out.add("objective", np.array([row.objective for row in history], dtype=float), "iteration")
    out.add("step", np.array([row.step for row in history], dtype=float), "iteration")
    out.add("note", [row.note for row in history], "iteration")
    for name in COUNTS:
        counts = np.array([getattr(row.counts, name) for row in history], dtype=np.int64)
        out.add(name, counts, "iteration")
    values = np.array([row.values for row in history], dtype=float)
    out.add("values", values.reshape(len(history), len(names)), "iteration", "parameter")


def read_counts(group: TableReader, name: str, rows: int) -> Ints:
    """One of `COUNTS` (rows,).

    Args:
        group: that has it.
        name: of it.
        rows: of the table.
    """
    if name in NEWER_COUNTS and name not in group:
        return np.full(rows, NEWER_COUNTS[name], dtype=np.int64)
    return group.ints(name, rows)


def read_history(file: h5py.File, n: int) -> tuple[Iteration, ...]:
    """The iterations; n is the number of parameters."""
    group = TableReader(file, "history")
    methods = group.texts("method")
    rows = len(methods)
    counts = [read_counts(group, name, rows).tolist() for name in COUNTS]
    return tuple(
        Iteration(method, number, objective, values, step, Counts(*cost), note)
        for method, number, objective, values, step, cost, note in zip(
            methods,
            group.ints("number", rows).tolist(),
            group.floats("objective", rows).tolist(),
            group.floats("values", rows, n),
            group.floats("step", rows).tolist(),
            zip(*counts, strict=True),
            group.texts("note", rows),
            strict=True,
        )
    )


def write_grid(file: h5py.File, grid: Grid) -> None:
    """Writes ``/grid``: the axes under the names of their parameters, and ``objective``."""
    names = [_axis_name(name) for name in grid.names]
    out = TableWriter(file, "grid", dict(zip(names, grid.axes, strict=True)))
    out.group.attrs.create("parameters", list(grid.names), dtype=h5py.string_dtype())
    out.add("objective", grid.objective, *names)


def read_grid(file: h5py.File) -> Grid:
    """The discrepancy over one or two parameters."""
    group = TableReader(file, "grid")
    names = group.attribute_texts("parameters")
    axes = tuple(group.array(_axis_name(name), "f") for name in names)
    return Grid(names, axes, group.floats("objective", *(len(axis) for axis in axes)))


def _axis_name(parameter: str) -> str:
    """Name of the dataset of an axis, which must not be that of the discrepancy."""
    return f"{parameter}_" if parameter == "objective" else parameter


def write_certificate(file: h5py.File, found: Certificate, names: tuple[str, ...]) -> None:
    """Writes ``/certificate``, one row a yield plane.

    The kind of stationary point, the gradient and the proven bound are attributes.

    Args:
        file: the result.
        found: the certificate.
        names: of the parameters.
    """
    activity = found.activity
    axes = {
        "plane": activity.planes,
        "stage": activity.stages,
        "parameter": names,
        "bounded": tuple(found.lower_bounds),
        "remark": found.remarks,
    }
    out = TableWriter(file, "certificate", axes)
    out.add("points", np.asarray(activity.points, dtype=np.int64), "plane", "stage")
    out.add("biactive", np.asarray(activity.biactive, dtype=np.int64), "plane", "stage")
    out.add("distance", activity.distances, "plane", unit="Pa")
    out.add("reached", activity.reached, "plane", unit="Pa")
    unit = "Pa per SI unit of the parameter"
    out.add("slope", activity.slopes, "plane", "parameter", unit=unit)
    least = np.array([*found.lower_bounds.values()], dtype=np.float64)
    out.add("at_least", least, "bounded", unit="SI unit of the parameter")
    out.group.attrs["kind"] = plain_text(found.kind)
    for name in _CERTIFICATE_NUMBERS:
        out.group.attrs[name] = np.float64(getattr(found, name))


def read_certificate(file: h5py.File) -> Certificate:
    """The certificate."""
    group = TableReader(file, "certificate")
    planes, stages, names = (group.texts(axis) for axis in ("plane", "stage", "parameter"))
    shape = len(planes), len(stages)
    bounded = group.texts("bounded")
    least = group.floats("at_least", len(bounded))
    activity = Activity(
        planes=planes,
        stages=stages,
        points=group.ints("points", *shape),
        biactive=group.ints("biactive", *shape),
        distances=group.floats("distance", len(planes)),
        reached=group.floats("reached", len(planes)),
        slopes=group.floats("slope", len(planes), len(names)),
    )
    return Certificate(
        kind=group.attribute("kind", str),
        gradient=group.attribute("gradient", float),
        activity=activity,
        lower_bounds=dict(zip(bounded, map(float, least), strict=True)),
        bound=group.attribute("bound", float),
        gap=group.attribute("gap", float),
        remarks=group.texts("remark"),
    )


def write_members(file: h5py.File, table: MemberForces) -> None:
    """Writes ``/structures``, one row a straight piece of a lining or wall, or a bar.

    The axis ``member`` holds names such as ``lining:12``. Forces of linings are per metre out of
    plane or of circumference, those of bars are of one bar. ``N_hoop`` stands there if there are
    shells, ``prestress`` if bars were stressed: the force to which, at which stages.
    """
    pairs = zip(table.structures, table.numbers, strict=True)
    axes = {
        "member": [f"{name}:{number}" for name, number in pairs],
        "stage": table.stages,
        "end": ("first", "second"),
        "axis": ("x", "y", "z")[: table.ends.shape[2]],
    }
    out = TableWriter(file, "structures", axes)
    out.add("structure", table.structures, "member")
    out.add("number", np.asarray(table.numbers, dtype=np.int64), "member")
    out.add("per_metre", table.per_metre, "member")
    out.add("points", table.ends, "member", "end", "axis", unit="m")
    out.add("N", table.axial, "member", "stage", unit="N, or N/m where per_metre")
    out.add("M", table.moment, "member", "end", "stage", unit="N m/m")
    out.add("Q", table.shear, "member", "stage", unit="N/m")
    if np.isfinite(table.hoop).any():
        out.add("N_hoop", table.hoop, "member", "stage", unit="N/m")
    if np.isfinite(table.prestress).any():
        out.add("prestress", table.prestress, "member", "stage", unit="N")


def read_members(file: h5py.File) -> MemberForces:
    """The forces in linings and bolts."""
    group = TableReader(file, "structures")
    structures, stages = group.texts("structure"), group.texts("stage")
    n, k = len(structures), len(stages)
    nowhere = np.full((n, k), np.nan)
    return MemberForces(
        structures=structures,
        numbers=group.ints("number", n),
        stages=stages,
        ends=group.floats("points", n, 2, len(group.texts("axis"))),
        axial=group.floats("N", n, k),
        moment=group.floats("M", n, 2, k),
        shear=group.floats("Q", n, k),
        per_metre=group.bools("per_metre", n),
        hoop=group.floats("N_hoop", n, k) if "N_hoop" in group else nowhere,
        prestress=group.floats("prestress", n, k) if "prestress" in group else nowhere,
    )


REACTIONS = "reactions"
"""Group of the reactions of supports."""


def write_reactions(file: h5py.File, table: SupportReactions) -> None:
    """Writes ``/reactions``: resultants of supports, NaN where one does not hold."""
    axes = {
        "support": table.supports,
        "state": table.states,
        "axis": ("x", "y", "z")[: table.force.shape[2]],
    }
    out = TableWriter(file, REACTIONS, axes)
    unit = "N, or N/m in plane strain"
    out.add("force", table.force, "support", "state", "axis", unit=unit)


def read_reactions(file: h5py.File) -> SupportReactions:
    """The reactions of supports."""
    group = TableReader(file, REACTIONS)
    supports, states = group.texts("support"), group.texts("state")
    force = group.floats("force", len(supports), len(states), len(group.texts("axis")))
    return SupportReactions(supports, states, force)


YIELDED = "yielded"
"""Group of how far ground yields."""

_OF_YIELDED = {"volume": "m3, or m2 in plane strain", "share": "1", "reach": "m", "radius": "m"}


def write_yielded(file: h5py.File, table: YieldedGround) -> None:
    """Writes ``/yielded``: how far ground yields, NaN where that has no meaning."""
    axes = {"state": table.states, "axis": ("x", "y", "z")[: table.lower.shape[1]]}
    out = TableWriter(file, YIELDED, axes)
    out.group.attrs["unit"] = plain_text(table.unit)
    for name, unit in _OF_YIELDED.items():
        out.add(name, getattr(table, name), "state", unit=unit)
    for name in ("lower", "upper"):
        out.add(name, getattr(table, name), "state", "axis", unit="m")


def read_yielded(file: h5py.File) -> YieldedGround:
    """How far ground yields."""
    group = TableReader(file, YIELDED)
    states, dim = group.texts("state"), len(group.texts("axis"))
    columns = {name: group.floats(name, len(states)) for name in _OF_YIELDED}
    ends = {name: group.floats(name, len(states), dim) for name in ("lower", "upper")}
    return YieldedGround(states, **columns, **ends, unit=group.attribute("unit", str))


MECHANISM = "mechanism"
"""Group of the mechanism of a collapse."""


def write_mechanism(file: h5py.File, found: Mechanism) -> None:
    """Writes ``/mechanism``: how the ground moves at the first stage that collapses."""
    axes = {
        "node": np.arange(found.mesh.n_nodes),
        "component": np.arange(found.mesh.dim),
        "element": np.arange(found.mesh.n_elements),
    }
    out = TableWriter(file, MECHANISM, axes)
    out.group.attrs["stage"] = plain_text(found.stage)
    out.group.attrs["state"] = np.int64(found.state)
    out.group.attrs["carried"] = np.float64(found.fraction)
    out.add("velocity", found.velocity, "node", "component", unit="1")
    out.add("shear", found.shear, "element", unit="1")
    out.add("present", found.present, "element")


def read_mechanism(file: h5py.File, mesh: Mesh) -> Mechanism:
    """The mechanism of a collapse, on the mesh of the fields."""
    group = TableReader(file, MECHANISM)
    nodes, elements = (
        len(group.ints(axis, n))
        for axis, n in (("node", mesh.n_nodes), ("element", mesh.n_elements))
    )
    return Mechanism(
        group.attribute("stage", str),
        int(group.attribute("state", float)),
        group.attribute("carried", float),
        mesh,
        group.bools("present", elements),
        group.floats("velocity", nodes, len(group.ints("component", mesh.dim))),
        group.floats("shear", elements),
    )


MODEL_ERROR = "model_error"
"""Group of the model error."""

_MODEL_ERROR_NUMBERS = ("size", "lower95", "upper95", "length")
_OF_GAUGES = tuple(
    f"{name}{end}" for name in ("factor", "zero") for end in ("", "_lower95", "_upper95")
)


def write_model_error(file: h5py.File, table: ModelErrorTable) -> None:
    """Writes ``/model_error``: its size, and what it is made of at every reading.

    Args:
        file: the result.
        table: the model error.
    """
    out = TableWriter(
        file,
        MODEL_ERROR,
        {"eta": table.sizes, "state": table.states, "reading": np.arange(len(table.steps))},
    )
    for name in (*_MODEL_ERROR_NUMBERS, *_OF_GAUGES):
        out.group.attrs[name] = np.float64(getattr(table, name))
    for name in ("kind", "sentence"):
        out.group.attrs[name] = plain_text(getattr(table, name))
    out.group.attrs.create("findings", texts(table.findings), dtype=h5py.string_dtype())
    out.add("weights", table.weights, "eta")
    for name in ("steps", "floors"):
        out.add(name, getattr(table, name), "reading", "state")


def read_model_error(file: h5py.File) -> ModelErrorTable:
    """The model error of a fit."""
    group = TableReader(file, MODEL_ERROR)
    states, sizes = group.texts("state"), group.array("eta", "f")
    rows = len(group.array("reading", "iu"))
    return ModelErrorTable(
        kind=group.attribute("kind", str),
        size=group.attribute("size", float),
        lower95=group.attribute("lower95", float),
        upper95=group.attribute("upper95", float),
        length=group.attribute("length", float),
        sentence=group.attribute("sentence", str),
        sizes=sizes,
        weights=group.floats("weights", len(sizes)),
        states=states,
        steps=group.floats("steps", rows, len(states)),
        floors=group.floats("floors", rows, len(states)),
        findings=group.attribute_texts("findings"),
        **{name: group.attribute(name, float) for name in _OF_GAUGES if name in group.group.attrs},
    )
