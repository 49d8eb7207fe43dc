"""Every view of every table against the same file read with plain h5py.

The names, axes and units that each view has are written down here once more, by hand; nothing of
the declaration of the columns is used.
"""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from functools import cache
from typing import Any

import h5py
import numpy as np
import pytest

from geoident.api.tables import Parameters, tables_of
from geoident.io.result.file import read_result, write_result
from geoident.model.results.posterior import PosteriorDraws
from geoident.model.results.result import AccuracyTable, MemberForces, Result, SupportReactions
from geoident.model.results.rivals import Evidence, ModelComparison, ModelScore, Rivals
from geoident.model.results.surface import SurfaceTable
from geoident.report.text.csv_tables import csv_tables, csv_text
from geoident.report.text.json import dumps, result_object
from geoident.report.text.result import result_text
from geoident.workflow.diff import numbers
from tests.io.result.conftest import make_result
from tests.io.result.test_certificate import proof
from tests.io.result.test_result_file import assert_same

NAN = math.nan
GPA, MPA, MM, KILO = 1e9, 1e6, 1e-3, 1e3
UNITS = {"GPa": GPA, "MPa": MPA, "mm": MM, "": 1.0, "m": 1.0}
OWN = "unit"
"""The unit stands in a column of its own."""


def whole_result() -> Result:
    """A result with every table that goes into the views."""
    result = make_result(2)
    rng = np.random.default_rng(1)
    k = len(result.gauges.readings)
    forces = rng.normal(size=(3, 2)) * 1e6
    forces[2, 0] = NAN
    bent = np.where(np.arange(3) < 2, 1.0, NAN)
    return replace(
        result,
        certificate=proof(result.parameters.names, bound=3.5, gap=0.02),
        members=MemberForces(
            ("wall", "wall", "bolt"), np.array([1, 2, 1]), result.gauges.stages,
            rng.normal(size=(3, 2, 2)), forces, rng.normal(size=(3, 2, 2)) * bent[:, None, None],
            rng.normal(size=(3, 2)) * bent[:, None], np.array([True, True, False]),
            np.full((3, 2), NAN), np.array([[NAN, NAN], [NAN, NAN], [NAN, 4e3]]),
        ),
        reactions=SupportReactions(
            ("left", "base"), ("virgin", *result.gauges.stages), rng.normal(size=(2, 3, 2)) * 1e6
        ),
        accuracies=AccuracyTable(
            ("tape: reading", "level: reading"), np.array([1e-4, 2e-4]), np.array([5e-5, 1e-4]),
            np.array([2e-4, 3e-4]), ("reading", "reading"), ("length", "length"), ("mm", "mm"),
            np.zeros(k, dtype=np.int64), np.zeros((3, 2)), np.full(3, 1 / 3), np.zeros(3),
        ),
        rivals=Rivals(
            np.array([[1e10, 8e6], [2e10, 7e6]]), np.array([1.0, 2.0]), np.array([0.7, 0.3]),
            np.stack([np.diag([4e16, 9e10])] * 2),
        ),
        evidence=Evidence(1.0, 2.5, 3),
        comparison=ModelComparison(
            (
                ModelScore("a", "a.h5", 2, "converged", 1.0, 2.0, 3.0),
                ModelScore("b", "b.h5", 3, "poor-fit", 1.5, 1.0, 3.5, 0.5, 2, 1),
            ),
            0, True, 5, ("S.",),
        ),
        surface=SurfaceTable(
            "runs.csv", 4, ("EX1.a5", "CV1"), result.gauges.stages, ("linear", "quadratic"),
            np.array([1e-4, 2e-4]), np.array([1e-5, 2e-5]), np.array([1e-4, 3e-4]),
            np.array([0.0, 1e-3]), np.array([1.0, 2.0]), ("mm", "mm"), ("length", "length"),
        ),
        posterior=PosteriorDraws(
            result.parameters.names, ("", ""), 1e10 * (1 + rng.random((2, 30, 2))),
            rng.random((2, 30)), "ensemble", NAN, np.array([20.0, 30.0]), np.array([1.01, 1.02]),
            0.4, 77, ("EX1.a5", "CV1"), ("bench 1", "bench 1"), rng.random((2, 10, 2)),
            np.arange(0, 30, 3),
        ),
    )  # fmt: skip


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = str(tmp_path_factory.mktemp("views") / "a.fit.h5")
    write_result(whole_result(), file, overwrite=False)
    return file


@cache
def result_of(path: str) -> Result:
    """The result as it is read; once for all tests."""
    return read_result(path)


def at(file: h5py.File, place: str, **labels: Any) -> Any:
    """The entry of a dataset at labels of its axes; of ``ci95[lower]`` that label along one more.

    A number that is not determined, or not known, is NaN.
    """
    name, _, label = place.rstrip("]").partition("[")
    data, index = file[name], []
    for dim in data.dims:
        scale = dim[0]
        axis = scale.name.rpartition("/")[2]
        wanted = labels.get(axis, label)
        known = scale.asstr()[:] if scale.dtype.kind == "O" else scale[:]
        index.append(
            list(known).index(wanted)
            if scale.dtype.kind == "O"
            else int(np.argmin(np.abs(known - float(wanted))))
        )
    if name == "parameters/value" and np.isnan(file["parameters/sd"][tuple(index)]):
        return NAN
    entry = data[tuple(index)]
    if name == "gauges/computed" and not file["gauges/used"][tuple(index)]:
        mean = file["prediction/mean"][tuple(index)]  # a reading outside the fit is held against it
        entry = mean if np.isfinite(mean) else entry
    return entry.decode() if isinstance(entry, bytes) else entry


def same(a: Any, b: Any) -> bool:
    if isinstance(a, str) and isinstance(b, str):
        return a == b
    return float(a) == pytest.approx(float(b), rel=1e-9, abs=1e-15, nan_ok=True)


BOTH, NAME = {"gauge": "gauge", "stage": "stage"}, {"parameter": "parameter"}
INTERVAL = {"lower95": ("ci95[lower]", OWN), "upper95": ("ci95[upper]", OWN)}
FIVE = ("standardized", "studentized", "weight", "leverage", "distance")
QUANTILES = (0.025, 0.05, 0.25, 0.5, 0.75, 0.95, 0.975)

SHEETS: dict[str, tuple[str, dict[str, str], dict[str, tuple[str, Any]]]] = {
    "parameters": (
        "parameters", NAME,
        {
            "value": ("value", OWN), "sd": ("sd", OWN), **INTERVAL, "start": ("start", OWN),
            "lower": ("lower", OWN), "upper": ("upper", OWN), "unit": ("display_unit", 1),
            "at_bound": ("at_bound", 1), "determined": ("determined", 1),
        },
    ),
    "gauges": (
        "gauges", BOTH,
        {
            **{name: (name, OWN) for name in ("measured", "computed", "residual", "sd")},
            "used": ("used", 1), "unit": ("display_unit", 1),
        },
    ),
    "diagnostics": (
        "diagnostics", BOTH,
        {
            **{name: (name, 1) for name in FIVE},
            "influence_E_rock": ("influence[E_rock]", 1),
            "influence_sigma_v": ("influence[sigma_v]", 1),
        },
    ),
    "prediction": (
        "prediction", BOTH,
        {
            "predicted": ("mean", OWN), "sd": ("sd", OWN), "lower95": ("lower95", OWN),
            "upper95": ("upper95", OWN),
        },
    ),
    "history": (
        "history", {"iteration": "iteration"},
        {
            **{name: (name, 1) for name in ("method", "objective", "step", "evaluations")},
            **{name: (name, 1) for name in ("factorizations", "solves", "note")},
            "E_rock [GPa]": ("values[E_rock]", GPA), "sigma_v [MPa]": ("values[sigma_v]", MPA),
        },
    ),
    "correlation": (
        "parameters", NAME, {n: (f"correlation[{n}]", 1) for n in ("E_rock", "sigma_v")}
    ),
    "structures": (
        "structures", {"member": "member", "stage": "stage"},
        {
            "N (kN)": ("N", KILO), "Q (kN)": ("Q", KILO), "M_first (kNm)": ("M[first]", KILO),
            "M_second (kNm)": ("M[second]", KILO), "stressed_to (kN)": ("prestress", KILO),
            "structure": ("structure", 1), "number": ("number", 1),
        },
    ),
    "reactions": (
        "reactions", {"support": "support", "stage": "state"},
        {"R_x (kN)": ("force[x]", KILO), "R_y (kN)": ("force[y]", KILO)},
    ),
    "yielded": (
        "yielded", {"stage": "state"},
        {
            "volume (m3)": ("volume", 1), "share": ("share", 1),
            "from_excavation (m)": ("reach", 1), "from_centre (m)": ("radius", 1),
            **{f"{a}_{end} (m)": (f"{name}[{a}]", 1) for a in "xy"
               for end, name in (("min", "lower"), ("max", "upper"))},
        },
    ),
    "opening": (
        "opening", {"stage": "stage"},
        {
            "pressure (MPa)": ("stage_pressure", MPA),
            "wall_inwards (mm)": ("stage_displacement", MM),
            "plastic_radius (m)": ("stage_plastic_radius", 1),
        },
    ),
    "ground-reaction": (
        "opening", {"pressure (MPa)": "pressure"},
        {"wall_inwards (mm)": ("displacement", MM), "plastic_radius (m)": ("plastic_radius", 1)},
    ),
    "opening-supports": (
        "opening", {"support": "support", "stage": "stage"},
        {"pressure (MPa)": ("support_pressure", MPA), "capacity (MPa)": ("support_capacity", MPA)},
    ),
    "opening-stresses": (
        "opening", {"stage": "stage", "distance (m)": "radii"},
        {
            "radial_compression (MPa)": ("radial", MPA), "hoop_compression (MPa)": ("hoop", MPA),
        },
    ),
    "face": (
        "face", {"stage": "stage"},
        {
            "distance (m)": ("stage_distance", 1), "share_of_motion": ("stage_share", 1),
            "released_stress": ("stage_released", 1), "zero_of_gauges": ("stage_zero", 1),
        },
    ),
    "face-profile": ("face", {"distance (m)": "distance"}, {"share_of_motion": ("share", 1)}),
    "grid": (
        "grid", {"E_rock [GPa]": "E_rock", "sigma_v [MPa]": "sigma_v"},
        {"objective": ("objective", 1)},
    ),
    "readings": (
        "readings", {"reading": "reading"},
        {
            "gauge": ("channel", 1), "stage": ("stage", 1), "reason": ("reason", 1),
            **{name: (name, OWN) for name in ("value", "computed", "sd")}, "used": ("used", 1),
        },
    ),
    "posterior": (
        "posterior_summary", NAME,
        {
            "mean": ("mean", OWN), "sd": ("sd", OWN), "effective_size": ("ess", 1),
            "r_hat": ("r_hat", 1), **{f"q{100 * q:g}": (f"quantiles[{q}]", OWN) for q in QUANTILES},
        },
    ),
    "accuracies": (
        "accuracies", {"errors": "component"},
        {"sd": ("values", 1), "lower95": ("lower95", 1), "upper95": ("upper95", 1)},
    ),
}  # fmt: skip
"""Table to its group, header of an axis to the axis, header to dataset and unit."""

SCALES = {"pressure (MPa)": MPA, "E_rock [GPa]": GPA, "sigma_v [MPa]": MPA}


def rows_of(path: str, table: str) -> list[dict[str, str]]:
    text = csv_text(csv_tables(result_of(path))[table])
    rows: list[dict[str, Any]] = list(csv.DictReader(text.splitlines()))
    for number, row in enumerate(rows):
        row["reading"] = number
        row["member"] = f"{row.get('structure')}:{row.get('number')}"
    return rows


def cell(text: str) -> Any:
    """What a cell of CSV says."""
    if text in ("yes", "no"):
        return text == "yes"
    try:
        return float(text or "nan")
    except ValueError:
        return text


def test_the_whole_result_comes_back(path: str) -> None:
    assert_same(whole_result(), result_of(path))


@pytest.mark.parametrize("table", SHEETS)
def test_spreadsheets_have_what_the_file_has(path: str, table: str) -> None:
    group, axes, columns = SHEETS[table]
    rows = rows_of(path, table)
    assert rows
    with h5py.File(path) as file:
        for row in rows:
            labels = {
                axis: float(row[head]) * SCALES[head] if head in SCALES else row[head]
                for head, axis in axes.items()
            }
            for head, (dataset, unit) in columns.items():
                size = UNITS[row["unit"]] if unit == OWN else unit
                found, expected = cell(row[head]), at(file, f"{group}/{dataset}", **labels)
                if expected == "" or (isinstance(expected, float) and np.isinf(expected)):
                    assert row[head] in ("", "inf", "-inf"), (row, head)
                elif isinstance(expected, str):
                    assert row[head] == expected
                else:
                    assert same(found, expected / size), (row, head, expected)


def test_no_table_is_left_out(path: str) -> None:
    others = {"sensitivity", "draws"}  # in units of both axes; thousands of rows
    assert set(csv_tables(result_of(path))) == {*SHEETS, *others}


def test_data_frames_are_the_spreadsheets(path: str) -> None:
    tables = tables_of(result_of(path))
    for name, made in csv_tables(result_of(path)).items():
        frame = tables[name].to_frame()
        assert tuple(frame.columns) == made.header
        assert len(frame) == len(made.rows)
    frame = Parameters(result_of(path)).to_frame(si=True)
    with h5py.File(path) as file:
        for name, row in frame.iterrows():
            for head, (dataset, unit) in SHEETS["parameters"][2].items():
                if unit == OWN:
                    expected = at(file, f"parameters/{dataset}", parameter=name)
                    assert same(row[head], np.nan if np.isinf(expected) else expected)


OBJECTS: dict[str, tuple[str, dict[str, str], dict[str, str]]] = {
    "parameters": (
        "parameters", NAME,
        {
            "value": "value", "sd": "sd", "lower95": "ci95[lower]", "upper95": "ci95[upper]",
            "at_bound": "at_bound", "determined": "determined", "unit": "unit",
            "prior_kind": "prior_kind", "prior_mean": "prior_mean", "prior_sd": "prior_sd",
        },
    ),
    "gauges": (
        "gauges", BOTH,
        {n: n for n in ("measured", "computed", "sd", "used", "bad", "unit")},
    ),
    "predictions": ("prediction", BOTH, {n: n for n in ("mean", "sd", "lower95", "upper95")}),
    "readings": (
        "readings", {"reading": "reading"},
        {
            "gauge": "channel",
            **{n: n for n in ("stage", "value", "computed", "sd", "used", "unit")},
        },
    ),
    "diagnostics/readings": ("diagnostics", BOTH, {n: n for n in FIVE}),
    "structures": (
        "structures", {"member": "member", "stage": "stage"},
        {n: n for n in ("N", "Q", "prestress", "per_metre", "structure", "number")},
    ),
    "reactions": ("reactions", {"support": "support", "stage": "state"}, {}),
    "yielded": (
        "yielded", {"stage": "state"},
        {"volume": "volume", "share": "share", "from_excavation": "reach", "from_centre": "radius"},
    ),
    "opening/stages": (
        "opening", {"stage": "stage"},
        {n: f"stage_{n}" for n in ("pressure", "displacement", "plastic_radius")},
    ),
    "face/stages": (
        "face", {"stage": "stage"},
        {n: f"stage_{n}" for n in ("distance", "share", "released", "zero")},
    ),
    "accuracies": (
        "accuracies", {"errors": "component"},
        {"sd": "values", "lower95": "lower95", "upper95": "upper95"},
    ),
    "comparison/models": (
        "models", {"name": "model"},
        {n: n for n in ("path", "status", "objective", "log_evidence", "backtest", "modes")},
    ),
    "surface/readings": (
        "surface", {"reading": "column"},
        {
            "gauge": "gauge", "stage": "stage", "surface": "kind",
            **{n: n for n in ("left_out", "own", "lower", "upper")},
        },
    ),
    "posterior/parameters": (
        "posterior_summary", NAME,
        {"mean": "mean", "sd": "sd", "effective_size": "ess", "r_hat": "r_hat"},
    ),
    "rivals": ("rivals", {"reading": "minimum"}, {"objective": "objective", "odds": "odds"}),
}  # fmt: skip
"""Place in the JSON to group, key of an axis to the axis, key to dataset; all in SI."""


@pytest.mark.parametrize("place", OBJECTS)
def test_programs_get_what_the_file_has(path: str, place: str) -> None:
    group, axes, columns = OBJECTS[place]
    rows = json.loads(dumps(result_object(result_of(path), case="c", output=path)))
    for key in place.split("/"):
        rows = rows[key]
    if isinstance(rows, dict):
        rows = [{**row, "parameter": name} for name, row in rows.items()]
    assert rows
    with h5py.File(path) as file:
        for number, row in enumerate(rows):
            row["reading"] = row.get("reading", number)
            row["member"] = f"{row.get('structure')}:{row.get('number')}"
            labels = {axis: row[key] for key, axis in axes.items()}
            for key, dataset in columns.items():
                expected = at(file, f"{group}/{dataset}", **labels)
                if row[key] is None:
                    assert expected == "" or not np.isfinite(expected), (row, key)
                else:
                    assert same(row[key], expected), (row, key, expected)


ARRAYS = {
    **{name: f"gauges/{name}" for name in ("measured", "computed", "sd", "used", "bad")},
    "sensitivity": "sensitivity/sensitivity",
    "estimate_sd": "parameters/sd",
    "estimate_lower95": "parameters/ci95[lower]",
    "estimate_upper95": "parameters/ci95[upper]",
    "lower_bound": "parameters/lower",
    "upper_bound": "parameters/upper",
    **{
        name: f"parameters/{name}"
        for name in ("start", "at_bound", "determined", "covariance", "correlation")
    },
    "predicted": "prediction/mean",
    **{f"predicted_{name}": f"prediction/{name}" for name in ("sd", "lower95", "upper95")},
    "misfit": "grid/objective",
    "mechanism": "mechanism/velocity",
    "mechanism_shear": "mechanism/shear",
}


def test_data_sets_have_what_the_file_has(path: str) -> None:
    arrays = pytest.importorskip("geoident.api.arrays")
    data = arrays.dataset(result_of(path))
    with h5py.File(path) as file:
        for name, place in ARRAYS.items():
            dataset, _, label = place.rstrip("]").partition("[")
            expected = file[dataset][()]
            if label:
                expected = expected[:, ["lower", "upper"].index(label)]
            np.testing.assert_array_equal(np.asarray(data[name]), expected, err_msg=name)
    others = {"estimate", "points", "displacement", "stress", "present", "yielded", "draws"}
    assert set(data.data_vars) == {*ARRAYS, *others}


def test_a_comparison_has_the_numbers_of_the_file(path: str) -> None:
    datasets = {
        "parameters": {"value": "parameters/value", "sd": "parameters/sd",
                       "lower95": "parameters/ci95[lower]", "upper95": "parameters/ci95[upper]"},
        "readings": {name: f"gauges/{name}" for name in ("measured", "sd", "computed")},
        "predictions": {name: f"prediction/{name}" for name in ("mean", "lower95", "upper95")},
    }  # fmt: skip
    found = [pair for pair in numbers(result_of(path)) if pair[0].table in datasets]
    with h5py.File(path) as file:
        for place, amount in found:
            first, _, stage = place.item.partition(", ")
            labels = {"parameter": first, "gauge": first, "stage": stage}
            expected = at(file, datasets[place.table][place.quantity], **labels)
            assert amount.value == expected
        shapes = [file[name][()] for table in datasets.values() for name in table.values()
                  if "parameters" not in name]  # fmt: skip
        assert len(found) == 4 + sum(np.isfinite(values).sum() for values in shapes)


def test_the_screen_has_the_parameters_of_the_file(path: str) -> None:
    lines = result_text(replace(result_of(path), posterior=None)).splitlines()
    line = next(line for line in lines if line.startswith("E_rock "))
    with h5py.File(path) as file:
        value, low, high = (at(file, f"parameters/{name}", parameter="E_rock") / GPA
                            for name in ("value", "ci95[lower]", "ci95[upper]"))  # fmt: skip
    words = line.split()
    assert [float(words[1]), float(words[2]), float(words[4])] == pytest.approx(
        [value, low, high], rel=5e-3
    )
