"""Ground that yields while water leaves it: against closed forms and drained ground."""

import numpy as np
import pytest
from support.derivatives import assert_exact
from support.in_stages import model_at, read, write_msh
from support.meshes import box, regroup

from geoident.errors import CollapseError
from geoident.forward.analysis import plastic_step
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.staged import ResumableRun
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions
from geoident.workflow.running.jobs import load_inputs

DAY = 86400.0
HEAD = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
parameters:
  c: {start: 5 kPa, bounds: [1 kPa, 100 kPa]}
  phi: {start: 25 deg, bounds: [5 deg, 45 deg]}
materials:
  clay:
    E: 10 MPa
    nu: 0.3
    yield: {type: mohr-coulomb, cohesion: $c, friction: $phi, dilation: 0 deg}
    hydraulic: {permeability: 1e-9 m/s, storage: 1e-12 1/Pa}
groups: {all: clay}
in_situ: {model: constant, xx: -100 kPa, yy: -100 kPa, zz: -100 kPa}
"""
ELEMENT = """\
supports: {x0: x, x1: x, y0: y, y1: y}
drained: {y1: {}, x1: {}}
stages:
  - {name: press, supports: {x1: free, y1: {y: -30 mm}}, lasts: 0 d}
gauges:
  yy: {kind: stress, point: [0.4 m, 0.55 m], components: [yy], accuracy: 1 kPa}
  xx: {kind: stress, point: [0.4 m, 0.55 m], components: [xx], accuracy: 1 kPa}
  S: {kind: settlement, point: [1 m, 0.5 m], component: x, accuracy: 1 mm}
  p: {kind: piezometer, point: [0.4 m, 0.55 m], accuracy: 1 kPa}
"""
ELEMENT = HEAD + ELEMENT.replace("  S: {kind: settlement", "  S: {kind: displacement")
C, PHI, P0 = 5e3, np.radians(25.0), 100e3
HYDRAULIC = "    hydraulic: {permeability: 1e-9 m/s, storage: 1e-12 1/Pa}\n"


def element(folder, *changes):
    """A cube of clay under 100 kPa all around that a plate presses, free on one side."""
    write_msh(box("quad8", (2, 2), size=(1.0, 1.0)), folder / "m.msh", ["x0", "x1", "y0", "y1"])
    text = ELEMENT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "case.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("analysis", ["plane-strain", "axisymmetric"])
def test_undrained_strength_and_pressure_of_water_follow_from_the_effective_strength(
    tmp_path, analysis
):
    """Without dilation the mean effective stress stays: s' in the plane, p' in a triaxial test."""
    yy, xx, _, p = read(element(tmp_path, ("plane-strain", analysis)))[:, 0]
    strength = C * np.cos(PHI) + P0 * np.sin(PHI)
    pressure = strength
    if analysis == "axisymmetric":
        q = 6.0 * np.sin(PHI) / (3.0 - np.sin(PHI)) * (P0 + C / np.tan(PHI))
        strength, pressure = 0.5 * q, q / 3.0
    assert xx == pytest.approx(-P0, rel=1e-6)
    assert 0.5 * (xx - yy) == pytest.approx(strength, rel=1e-4)
    assert p == pytest.approx(pressure, rel=1e-4)


def test_slow_loading_ends_at_the_ground_without_time(tmp_path):
    slow = ("lasts: 0 d", "lasts: 1000 years, over: 900 years")
    time = read(element(tmp_path, slow))[:, 0]
    dry = ELEMENT[ELEMENT.index("  p: {kind") :]
    drained = read(
        element(tmp_path, (", lasts: 0 d", ""), (HYDRAULIC, ""), (dry, ""),
                ("drained: {y1: {}, x1: {}}\n", ""))
    )[:, 0]  # fmt: skip
    np.testing.assert_allclose(time[:3], drained, rtol=1e-7)
    assert time[3] == pytest.approx(0.0, abs=1.0)


def test_a_long_stage_ends_as_the_end_of_all_flow(tmp_path):
    long = read(element(tmp_path, ("lasts: 0 d", "lasts: 1000 years")))[:, 0]
    more = "lasts: 0 d}\n  - {name: end"
    end = read(element(tmp_path, ("lasts: 0 d", more)))[:, 1]
    np.testing.assert_allclose(long, end, rtol=1e-3, atol=1e-3)


def test_what_is_kept_to_begin_with_changes_no_reading(tmp_path, monkeypatch):
    """With derivatives, without them, and nothing: `WarmStart` bounds it by memory."""
    changes = ("lasts: 0 d", "lasts: 100 d, over: 50 d"), ("stages:", "time_steps: 1\nstages:")
    model = model_at(element(tmp_path, *changes))
    p, found = np.array([parameter.start for parameter in model.case.parameters]), []
    response = model.response([(c.name, "press") for c in model.case.channels])
    for most in (10**6, 2000, 0):
        monkeypatch.setattr(plastic_step, "_KEPT_IN_TIME", most)
        model.forget()
        response.evaluate(p)
        known = [one for kept in model.analysis.warm._known.values() for one in kept]
        found.append((response.evaluate(1.02 * p), len(known), {len(one.names) for one in known}))
    (full, n, names), (bare, n_bare, no_names), (none, n_none, _) = found
    assert (n, names, n_bare, no_names, n_none) == (n_bare, {2}, n, {0}, 0)
    for other in (bare, none):
        np.testing.assert_allclose(other[0], full[0], rtol=1e-7)
        scale = np.abs(full[1]).max()
        np.testing.assert_allclose(other[1], full[1], rtol=1e-5, atol=1e-7 * scale)


FOOTING = HEAD.replace("10 MPa", "50 MPa").replace("1e-9", "1e-10").replace("1e-12", "1e-11")
FOOTING += """\
supports: {x0: x, x1: x, y0: fixed, y1: y}
stages:
  - {name: press, supports: {y1: free, strip: {y: -16 mm}}, lasts: 0 d}
gauges:
  S: {kind: settlement, point: [0.4 m, 4 m], accuracy: 1 mm}
"""


def footing(folder, text=FOOTING, cells=(16, 8)):
    """Half a strip footing of 2 m on clay."""
    mesh = box("tri6", cells, size=(8.0, 4.0))
    top = mesh.points[np.concatenate([facets.nodes for facets in mesh.facets])]
    under = (top[..., 1] > 4.0 - 1e-9) & (top[..., 0] < 1.01)
    mesh.facet_groups["strip"] = np.flatnonzero(under.all(axis=1))
    write_msh(mesh, folder / "m.msh", ["x0", "x1", "y0", "y1", "strip"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


def test_an_undrained_strip_footing_bears_what_prandtl_found(tmp_path):
    model = model_at(footing(tmp_path))
    p = np.array([parameter.start for parameter in model.case.parameters])
    reactions = model.survey(p, fields=True).reactions
    borne = -reactions.force[reactions.supports.index("strip")][1, 1]
    strength = C * np.cos(PHI) + P0 * np.sin(PHI)
    # 16 by 8 elements are 4.9 % too strong, 24 by 12 3.3 %
    assert borne / strength == pytest.approx(2.0 + np.pi, rel=0.06)


def test_a_load_beyond_that_is_refused_with_its_moment(tmp_path):
    load = (
        "supports: {y1: free}, loads: {q: {on: strip, pressure: 400 kPa}}, lasts: 10 d, over: 8 d"
    )
    text = FOOTING[: FOOTING.index("  - {name: press")] + f"  - {{name: press, {load}}}\n"
    text += FOOTING[FOOTING.index("gauges:") :]
    text = text.replace("stages:", "drained: {y1: {}}\ntime_steps: 2\nstages:")
    path = footing(tmp_path, text, cells=(8, 4))
    model = model_at(path)
    with pytest.raises(CollapseError) as error:
        model.response([("S", "press")]).evaluate(np.array([5e3, PHI]))
    assert "at stage 'press', " in str(error.value)
    assert "days after it began, when" in str(error.value)


SITE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
time_steps: 1
parameters:
  E: {start: 8.3 MPa, bounds: [1 MPa, 100 MPa]}
  c: {start: 5 kPa, bounds: [0.1 kPa, 50 kPa]}
  phi: {start: 24 deg, bounds: [10 deg, 45 deg]}
  K0: {start: 0.62, bounds: [0.4, 1]}
  k: {start: 2e-9 m/s, bounds: [1e-10 m/s, 1e-7 m/s]}
  S: {start: 2e-8 1/Pa, bounds: [1e-10 1/Pa, 1e-6 1/Pa]}
  biot: {start: 0.9, bounds: [0.5, 1]}
  spacing: {start: 1.5 m, bounds: [0.5 m, 4 m]}
  M: {start: 0.4 kNm/m, bounds: [0.01 kNm/m, 100 kNm/m]}
  EA: {start: 20 MN/m, bounds: [1 MN/m, 100 MN/m]}
  q: {start: 30 kPa, bounds: [0 kPa, 100 kPa]}
  push: {start: 6 mm, bounds: [-20 mm, 20 mm]}
materials:
  clay:
    E: $E
    nu: 0.3
    density: 1700 kg/m3
    hydraulic: {permeability: [2 $k, $k], storage: $S, biot: $biot}
    yield: {type: mohr-coulomb, cohesion: $c, friction: $phi DILATION}
  drained clay:
    E: $E
    nu: 0.3
    density: 1700 kg/m3
    hydraulic:
      permeability: [2 $k, $k]
      storage: $S
      biot: $biot
      drains: {spacing: $spacing, diameter: 6 cm}
    yield: {type: mohr-coulomb, cohesion: $c, friction: $phi DILATION}
groups: {clay: clay, pit: clay}
supports: {x0: x, x1: x, y0: y}
gravity: 9.81 m/s2
in_situ: {model: geostatic, K0: $K0}
water: {table: 4 m}
structures:
  slab: {kind: beam, on: strip, EA: $EA, EI: 2 MNm2/m, yield: {M: $M}}
drained: {x0: {}}
stages:
  - {name: slab, build: [slab], lasts: 0 d}
  - {name: load, loads: {q: {on: strip, pressure: $q}}, lasts: 20 d, over: 5 d}
  - {name: dig, excavate: [pit], lasts: 10 d}
  - {name: drains, change: {clay: drained clay}, supports: {x1: {x: $push}}, lasts: 10 d, over: 4 d}
  - {name: end}
gauges:
  S: {kind: settlement, point: [2 m, 4 m], accuracy: 0.1 mm}
  W: {kind: displacement, component: x, point: [4 m, 3 m], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [2 m, 2.5 m], accuracy: 1 kPa}
"""


def site(folder, dilation="dilation: 0 deg", text=SITE):
    """A loaded slab on clay beside a pit, without dilation or with other flow ("": associated)."""
    mesh = regroup(
        box("tri6", (6, 4), size=(6.0, 4.0)),
        pit=lambda c: (c[:, 1] > 3.0) & (c[:, 0] > 4.0),
        clay=lambda c: c[:, 1] > -1.0,
    )
    top = mesh.points[np.concatenate([facets.nodes for facets in mesh.facets])]
    under = (top[..., 1] > 4.0 - 1e-9) & (top[..., 0] > 0.9) & (top[..., 0] < 3.1)
    mesh.facet_groups["strip"] = np.flatnonzero(under.all(axis=1))
    write_msh(mesh, folder / "m.msh", ["x0", "x1", "y0", "y1", "strip"])
    path = folder / "case.yaml"
    path.write_text(text.replace(" DILATION", dilation and f", {dilation}"))
    return path


def is_exact(path, moments):
    model = model_at(path, moments)
    pairs = [(c.name, s) for c in model.case.channels for s in model.case.stage_names[1:]]
    p = np.array([parameter.start for parameter in model.case.parameters])
    assert_exact(model.response(pairs), p, model.names, step=1e-4)
    return model


def test_derivatives_are_exact(tmp_path):
    more = "  E: {start: 9 MPa, bounds: [1 MPa, 100 MPa]}\n"
    more += "  k: {start: 2e-9 m/s, bounds: [1e-10 m/s, 1e-7 m/s]}\nmaterials:"
    path = element(
        tmp_path, ("materials:", more), ("E: 10 MPa", "E: $E"), ("1e-9 m/s", "$k"),
        ("lasts: 0 d", "lasts: 2 d, over: 1 h"), ("stages:", "time_steps: 1\nstages:"),
    )  # fmt: skip
    is_exact(path, {"press": [0.02 * DAY, 0.5 * DAY]})


@pytest.mark.slow
@pytest.mark.parametrize("flow", ["dilation: 0 deg", "dilation: 5 deg"])
def test_derivatives_with_structures_that_yield_are_exact(tmp_path, flow):
    is_exact(site(tmp_path, flow), {"load": [5 * DAY], "dig": [0.0, 2 * DAY]})


@pytest.mark.slow
def test_derivatives_of_ground_that_hardens_are_exact(tmp_path):
    """Planes in place of the cone, whose distances grow."""
    planes = "".join(
        f"{{normal: [{x}, {y}, 0, 0], distance: 3.5 $c}}, " for x, y in ((0.6, -0.8), (-0.8, 0.6))
    )
    old = "{type: mohr-coulomb, cohesion: $c, friction: $phi DILATION}"
    new = f"{{type: planes, planes: [{planes}], hardening: 0.1 $E}}"
    friction = "  phi: {start: 24 deg, bounds: [10 deg, 45 deg]}\n"
    text = SITE.replace(old, new).replace(friction, "")
    is_exact(site(tmp_path, text=text), {"load": [5 * DAY], "dig": [2 * DAY]})


def test_strong_ground_is_elastic_ground(tmp_path):
    strong = SITE.replace("$phi DILATION", "$phi").replace("cohesion: $c", "cohesion: 1e6 $c")
    plain = strong.replace(
        "    yield: {type: mohr-coulomb, cohesion: 1e6 $c, friction: $phi}\n", ""
    )
    plain = plain.replace(", yield: {M: $M}", "")
    for name in ("c", "phi", "M"):
        plain = "".join(
            line for line in plain.splitlines(True) if not line.startswith(f"  {name}: {{start")
        )
    strong = strong.replace("M: {start: 0.4 kNm", "M: {start: 90 kNm")
    moments = {"load": [5 * DAY], "dig": [0.0, 2 * DAY]}
    elastic, found = (read(site(tmp_path, text=text), moments) for text in (plain, strong))
    np.testing.assert_allclose(found, elastic, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_errors_fall_with_the_number_of_steps_and_are_told(tmp_path):
    path = element(
        tmp_path, ("lasts: 0 d", "lasts: 2 d, over: 1 h"), ("stages:", "time_steps: 2\nstages:")
    )
    model, p = model_at(path, {"press": [0.5 * DAY]}), np.array([C, PHI])

    def readings(finer):
        options = RunOptions(derivatives=False, finer=finer)
        return ResumableRun(model, p, options).computed(len(model.case.stage_names) - 1)

    coarse, usual, fine = readings(1), readings(2), readings(4)
    ratio = np.abs(coarse - usual).max(axis=1) / np.abs(usual - fine).max(axis=1)
    assert (ratio > 1.4).all()
    told = model.time_step_errors(p)
    np.testing.assert_allclose(told, 2.0 * (usual - coarse), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("lasts", "method"),
    [(", lasts: 5 d", GaussNewtonOptions), ("", ComplementarityOptions)],
)
def test_strengths_are_fitted_by_gauss_newton_where_stages_last(tmp_path, lasts, method):
    """Where the case names no method; the search by complementarity takes too many analyses."""
    path = element(tmp_path, (", lasts: 0 d", lasts))
    (options,) = load_inputs(str(path)).case.fit.methods
    assert isinstance(options, method)
