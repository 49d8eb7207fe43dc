"""Stages of consolidating ground: derivatives, limits in time, heads, and what joins or leaves."""

import numpy as np
import pytest
from support.commands import run_command
from support.derivatives import assert_exact
from support.in_stages import model_at, read, write_msh
from support.meshes import box, regroup

from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.staged import ResumableRun

DAY = 86400.0
SITE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
parameters:
  E: {start: 8 MPa, bounds: [1 MPa, 100 MPa]}
  k: {start: 2e-9 m/s, bounds: [1e-10 m/s, 1e-7 m/s]}
  k_silt: {start: 1e-8 m/s, bounds: [1e-10 m/s, 1e-6 m/s]}
  S: {start: 2e-8 1/Pa, bounds: [1e-10 1/Pa, 1e-6 1/Pa]}
  biot: {start: 0.9, bounds: [0.5, 1]}
  weight: {start: 1800 kg/m3, bounds: [1000 kg/m3, 2500 kg/m3]}
  part: {start: 0.4, bounds: [0, 1]}
  head: {start: 3.3 m, bounds: [0 m, 6 m]}
  level: {start: 4.6 m, bounds: [2 m, 6 m]}
  push: {start: 4 mm, bounds: [-20 mm, 20 mm]}
  EA: {start: 20 MN/m, bounds: [1 MN/m, 100 MN/m]}
materials:
  clay: {E: $E, nu: 0.3, density: 1700 kg/m3, hydraulic: {permeability: [3 $k, $k]}}
  silt:
    E: 15 MPa
    nu: 0.25
    density: 1900 kg/m3
    hydraulic: {permeability: $k_silt, storage: $S, biot: $biot}
  sand: {E: 30 MPa, nu: 0.25, density: $weight}
  rock: {E: 200 MPa, nu: 0.2, density: 2500 kg/m3, hydraulic: impervious}
groups: {rock: rock, silt: silt, clay: clay, pit: clay, fill: absent, air: absent}
supports: {x0: x, x1: x, y0: y}
gravity: 9.81 m/s2
in_situ: {model: geostatic, K0: 0.6}
water: {table: 5 m}
structures:
  slab: {kind: beam, on: y0, EA: $EA, EI: 1 MNm2/m}
drained: {x0: {}}
stages:
  - {name: fill, install: {fill: sand}, build: [slab], lasts: 20 d, over: 5 d}
  - {name: dig, excavate: [pit], release: {pit: $part}, lasts: 10 d}
  - {name: lower, release: {pit: 1}, drained: {x1: {head: $head}}, lasts: 30 d}
  - {name: wetter, water: {table: $level}, lasts: 15 d}
  - {name: push, supports: {x1: {x: $push}}, lasts: 5 d, over: 2 d}
  - name: close
    drained: {x1: closed}
    loads: {q: {at: [3 m, 6.5 m], line_force: [0, -20 kN/m]}}
    lasts: 0 d
  - {name: end, drained: {x1: {head: $head}}}
gauges:
  S: {kind: settlement, point: [3 m, 6 m], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [5 m, 3.2 m], accuracy: 1 kPa}
  Q: {kind: piezometer, point: [7 m, 1.5 m], accuracy: 1 kPa}
"""


def site(folder, text=SITE):
    """Clay on silt on rock, with a pit and a fill."""
    mesh = regroup(
        box("tri6", (8, 7), size=(8.0, 7.0)),
        fill=lambda c: (c[:, 1] > 6.0) & (c[:, 0] < 4.0),
        air=lambda c: c[:, 1] > 6.0,
        pit=lambda c: (c[:, 1] > 4.0) & (c[:, 0] > 6.0),
        clay=lambda c: c[:, 1] > 3.0,
        silt=lambda c: c[:, 1] > 1.0,
    )
    write_msh(mesh, folder / "m.msh", ["x0", "x1", "y0", "y1"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


def test_derivatives_of_all_that_acts_in_time_are_exact(tmp_path):
    moments = {"fill": [3 * DAY], "lower": [0.0, DAY, 10 * DAY], "push": [DAY]}
    model = model_at(site(tmp_path), moments)
    pairs = [(c.name, s) for c in model.case.channels for s in model.case.stage_names[1:]]
    p = np.array([parameter.start for parameter in model.case.parameters])
    assert_exact(model.response(pairs), p, model.names)


COLUMN = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
parameters:
  k: {start: 1e-9 m/s, bounds: [1e-11 m/s, 1e-7 m/s]}
materials:
  clay: {E: 8 MPa, nu: 0.3, hydraulic: {permeability: $k}}
groups: {all: clay}
supports: {x0: x, x1: x, y0: fixed}
drained: {y1: {}}
stages:
  - {name: load, loads: {q: {on: y1, pressure: 50 kPa}}, lasts: 100 d}
gauges:
  S: {kind: settlement, point: [0.5 m, 6 m], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [0.5 m, 0 m], accuracy: 1 kPa}
"""
M = 8e6 * 0.7 / (1.3 * 0.4)
"""Its confined modulus, Pa."""


def column(folder, text=COLUMN, cells=12):
    """A column of clay of 6 m."""
    write_msh(box("quad8", (1, cells), size=(1.0, 6.0)), folder / "m.msh", ["x0", "x1", "y0", "y1"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


def test_a_stage_that_lasts_long_ends_as_one_without_duration(tmp_path):
    long = read(column(tmp_path, COLUMN.replace("100 d", "1000 years")))
    drained = read(column(tmp_path, COLUMN.replace(", lasts: 100 d", "")))
    np.testing.assert_allclose(long[0], drained[0], rtol=1e-9)
    np.testing.assert_allclose([long[1], drained[1]], 0.0, atol=1e-3)
    np.testing.assert_allclose(drained[0], 50e3 * 6.0 / M, rtol=1e-9)


def test_stages_one_after_another_go_on(tmp_path):
    whole = read(column(tmp_path), {"load": [10 * DAY, 30 * DAY]})
    more = "  - {name: wait, lasts: 20 d}\n  - {name: longer, lasts: 70 d}\ngauges:"
    parts = read(column(tmp_path, COLUMN.replace("100 d", "10 d").replace("gauges:", more)))
    np.testing.assert_allclose(parts, whole, rtol=1e-3)


def test_a_fill_that_comes_evenly_is_a_sum_of_small_ones(tmp_path):
    """Duhamel: the settlement under an even rise is the mean of those after sudden loads."""
    sudden = model_at(column(tmp_path), {"load": [n * DAY for n in range(1, 100)]})
    each = sudden.computed(np.array([1e-9]))
    text = COLUMN.replace("100 d", "100 d, over: 40 d")
    found = read(column(tmp_path, text), {"load": [20 * DAY, 40 * DAY, 70 * DAY]})
    fresh = np.column_stack([[0.0, 50e3 * 0.999], each])  # of a load that has just come
    for n, (first, last) in enumerate([(0, 20), (0, 40), (30, 70), (60, 100)]):
        days = np.arange(first, last + 1)
        simpson = np.array([1.0, *[4.0, 2.0] * (len(days) // 2 - 1), 4.0, 1.0])
        weights = simpson / 3.0 / 40.0
        np.testing.assert_allclose(found[:, n], fresh[:, days] @ weights, rtol=1e-2)


def test_a_strip_load_does_not_lock_as_water_becomes_incompressible(tmp_path):
    mesh = box("tri6", (10, 10), size=(10.0, 10.0))
    top = mesh.points[np.concatenate([f.nodes for f in mesh.facets])]
    loaded = (top[..., 1] > 10.0 - 1e-9) & (top[..., 0] < 2.1)
    mesh.facet_groups["strip"] = np.flatnonzero(loaded.all(axis=1))
    write_msh(mesh, tmp_path / "m.msh", ["x0", "x1", "y0", "strip"])
    text = COLUMN.replace("$k}", "$k, storage: STORAGE 1/Pa}")
    text = text.replace("on: y1", "on: strip").replace("{y1: {}}", "{strip: {}}")
    text = text.replace("[0.5 m, 6 m]", "[0 m, 10 m]").replace("lasts: 100 d", "lasts: 0 d")
    path, K, G = tmp_path / "case.yaml", 8e6 / 1.2, 8e6 / 2.6

    def settlement(storage, nu=None):
        words = text.replace("STORAGE", str(storage))
        if nu is not None:
            E = 9.0 * (K + 1.0 / storage) * G / (3.0 * (K + 1.0 / storage) + G)
            words = words.replace("nu: 0.3", f"nu: {nu}").replace("E: 8 MPa", f"E: {E} Pa")
            words = words.replace(", lasts: 0 d", "")
        path.write_text(words)
        return read(path)[0, 0]

    # Poisson's ratios 0.4955 and 0.49985 undrained, at which elements without pressures stiffen
    for storage, stiffer in ((3e-9, 5e-3), (1e-10, 2e-2)):
        whole = K + 1.0 / storage
        undrained = 0.5 * (3.0 * whole - 2.0 * G) / (3.0 * whole + G)
        assert settlement(storage) == pytest.approx(settlement(storage, undrained), rel=stiffer)
    assert settlement(1e-15) == pytest.approx(settlement(1e-10), rel=2e-3)


def test_heads_make_a_steady_flow_at_once_in_the_end_and_in_time(tmp_path):
    text = COLUMN.replace("drained: {y1: {}}", "drained: {y1: {head: 8 m}, y0: {head: 6 m}}")
    text = text.replace("loads: {q: {on: y1, pressure: 50 kPa}}, ", "").replace(
        "100 d", "300 years"
    )
    text += "  H: {kind: piezometer, point: [0.5 m, 1.5 m], accuracy: 1 kPa}\n"
    found = [read(column(tmp_path, text))]
    found.append(read(column(tmp_path, text.replace(", lasts: 300 years", ""))))
    heave = -9810.0 * 0.5 * (2.0 + 6.0) * 6.0 / M  # mean pressure of 19.6 and 58.9 kPa
    for settlement, foot, middle in found:
        assert foot == pytest.approx(6.0 * 9810.0)
        assert middle == pytest.approx((6.5 - 1.5) * 9810.0)
        assert settlement == pytest.approx(heave)
    still = text.replace("stages:", "water: {table: 7 m}\nstages:")
    settlement, foot, middle = read(column(tmp_path, still.replace(", lasts: 300 years", "")))
    assert foot == pytest.approx(6.0 * 9810.0)
    assert middle == pytest.approx((6.5 - 1.5) * 9810.0)
    before = 9810.0 * 0.5 * (1.0 + 7.0) * 6.0 / M  # of the water that stood still
    assert settlement == pytest.approx(heave + before, abs=1e-9)


def test_nothing_moves_where_all_of_a_push_is_held(tmp_path):
    """Ground under pressure leaves, and its stress and its pressure go on acting on the rest."""
    mesh = regroup(box("quad8", (1, 12), size=(1.0, 6.0)), upper=lambda c: c[:, 1] > 3.0)
    write_msh(mesh, tmp_path / "m.msh", ["x0", "x1", "y0", "y1"])
    text = COLUMN.replace("100 d", "0 d").replace("{all: clay}", "{rock: clay, upper: clay}")
    more = (
        "  - {name: dig, excavate: [upper], release: {upper: 0}, remove: [q], lasts: 0 d}\ngauges:"
    )
    text = text.replace("gauges:", more).replace("6 m], acc", "3 m], acc")
    text = text.replace("{permeability: $k}", "{permeability: $k, water_modulus: 20 MPa}")
    path = tmp_path / "case.yaml"
    path.write_text(text)
    (loaded, dug), (first, last) = read(path)
    assert loaded > 1e-4
    assert [dug, last] == pytest.approx([loaded, first], rel=1e-6)


def test_all_pressure_stays_when_the_water_table_falls(tmp_path):
    text = COLUMN.replace("loads: {q: {on: y1, pressure: 50 kPa}}", "water: {table: 2 m}")
    text = text.replace("stages:", "water: {table: 6 m}\nstages:")
    path = column(tmp_path, text)
    _, foot = read(path, {"load": [60.0]})
    assert foot[0] == pytest.approx(6.0 * 9810.0, rel=1e-3)
    _, foot = read(path, overrides=("stages[0].lasts=1000 years",))
    assert foot[0] == pytest.approx(2.0 * 9810.0, rel=1e-6)


def test_errors_of_steps_in_time_are_told(tmp_path):
    model = model_at(column(tmp_path), {"load": [DAY, 10 * DAY]})
    p = np.array([1e-9])
    told = model.time_step_errors(p)
    fine = ResumableRun(model, p, RunOptions(derivatives=False, finer=16)).computed(3)
    error = fine - model.computed(p)
    np.testing.assert_allclose(told, error, rtol=0.2, atol=1e-3 * np.abs(error).max(axis=1).max())


def test_later_stages_go_on_from_an_analysis_that_is_kept(tmp_path):
    model = model_at(column(tmp_path), {"load": [DAY, 10 * DAY]})
    early, late = model.case.stage_names[1], model.case.stage_names[3]
    p = np.array([1e-9])
    first, both = model.response([("S", early)]), model.response([("S", early), ("S", late)])
    begun = first.evaluate(p)
    went_on = both.evaluate(p)
    model.forget()
    anew = both.evaluate(p)
    np.testing.assert_allclose(went_on[0], anew[0], rtol=1e-13)
    np.testing.assert_allclose(went_on[1], anew[1], rtol=1e-13)
    np.testing.assert_allclose(begun[0], anew[0][:1], rtol=1e-13)


def test_supports_bear_what_has_come_at_every_moment(tmp_path):
    text = COLUMN.replace("100 d", "100 d, over: 20 d")
    model = model_at(column(tmp_path, text), {"load": [0.0, DAY, 30 * DAY]})
    reactions = model.survey(np.array([1e-9]), fields=True).reactions
    of_foot = reactions.force[reactions.supports.index("y0")][:, 1]
    np.testing.assert_allclose(of_foot, [0.0, 0.0, 2500.0, 50e3, 50e3], atol=1e-6 * 50e3)


def test_errors_fall_with_the_square_of_elements_and_of_steps(tmp_path):
    """A column drained on both ends: pressures of first order, steps of second order."""
    text = COLUMN.replace("{y1: {}}", "{y0: {}, y1: {}}")
    text = text.replace("point: [0.5 m, 0 m]", "point: [0.5 m, 3 m]")

    def middle(cells, finer):
        model = model_at(column(tmp_path, text, cells), {"load": [10 * DAY, 30 * DAY]})
        options = RunOptions(derivatives=False, finer=finer)
        return ResumableRun(model, np.array([1e-9]), options).computed(3)[1]

    by_mesh = [middle(cells, 8) for cells in (8, 16, 32)]
    by_step = [middle(16, finer) for finer in (1, 2, 4)]
    for coarse, usual, fine in (by_mesh, by_step):
        ratio = np.abs(coarse - usual).max() / np.abs(usual - fine).max()
        assert 3.0 < ratio < 5.5


def test_a_stage_in_which_nothing_takes_time_is_noted(tmp_path):
    text = COLUMN.replace(", hydraulic: {permeability: $k}", "").replace("drained: {y1: {}}\n", "")
    text = text.replace("nu: 0.3}", "nu: 0.3, density: 1000 kg/m3}")
    text = text[: text.index("  P: {kind")].replace("parameters:\n", "parameters: {}\n")
    text = text.replace("  k: {start: 1e-9 m/s, bounds: [1e-11 m/s, 1e-7 m/s]}\n", "")
    model = model_at(column(tmp_path, text))
    assert any("'load' lasts, and nothing in the ground takes time" in note for note in model.notes)
    drained = 50e3 * 6.0 / M
    assert model.computed(np.empty(0))[0, 0] == pytest.approx(drained)


def test_check_says_where_water_leaves(tmp_path):
    said = run_command("check", str(site(tmp_path))).stdout
    assert "Water leaves at x0." in said
    assert "drains x1 at head head (start 3.3 m)" in " ".join(said.split())
    assert "closes x1" in said
