"""Hardening soil whose water takes time: undrained, consolidating, in the end drained."""

import h5py
import numpy as np
import pytest
from support.derivatives import assert_slopes
from support.in_stages import model_at, read, write_msh
from support.meshes import box, regroup

from geoident.api import load_case, simulate
from geoident.errors import CollapseError
from geoident.forward.analysis.analysis import RunOptions

DAY = 86400.0

TRIAXIAL = """\
format: geoident-case/1
analysis: axisymmetric
mesh: {{file: m.msh}}
time_steps: 1
materials:
  sand:
    E: 60 MPa
    nu: 0.2
    yield:
      {{type: hardening-soil, E50: 20 MPa, Eoed: 16 MPa, K0nc: 0.4408, m: 0.65, cohesion: 0 kPa,
       friction: 34 deg}}
    hydraulic: {{permeability: 1e-6 m/s, storage: 1e-12 1/Pa}}
groups: {{all: sand}}
supports: {{x0: x, y0: y, y1: y}}
drained: {{x1: {{}}}}
in_situ: {{model: constant, xx: -300 kPa, yy: -300 kPa, zz: -300 kPa}}
stages:
{stages}
gauges:
  yy: {{kind: stress, point: [0.4 m, 0.55 m], components: [yy], accuracy: 1 kPa}}
  xx: {{kind: stress, point: [0.4 m, 0.55 m], components: [xx], accuracy: 1 kPa}}
  p: {{kind: piezometer, point: [0.4 m, 0.55 m], accuracy: 1 kPa}}
"""


def triaxial(folder, strains, lasts):
    """Loose Hostun sand that a plate presses to strains; the case file."""
    write_msh(box("quad8", (1, 1), size=(1.0, 1.0)), folder / "m.msh", ["x0", "x1", "y0", "y1"])
    stages = "\n".join(
        f"  - {{name: stage {n}, supports: {{y1: {{y: {-1e3 * strain!r} mm}}}}{lasts}}}"
        for n, strain in enumerate(strains, 1)
    )
    path = folder / "case.yaml"
    path.write_text(TRIAXIAL.format(stages=stages))
    return path


def test_the_water_of_an_undrained_triaxial_test_is_as_published(tmp_path, verification):
    """It stays in the ground, where `test_hardening_soil` moves edges so that the volume stays."""
    yy, xx, p = read(triaxial(tmp_path, (0.01, 0.1), ", lasts: 0 d"))
    np.testing.assert_allclose(xx, -300e3, rtol=1e-6)
    mean = -(yy + 2.0 * xx) / 3.0 - p
    found = np.array([p[1], mean[1], (xx - yy)[1]])
    published = np.array([0.555 * 300e3, 246e3, 339e3])
    verification("undrained-triaxial", "", [1, 2, 3], exact=published, found=found)
    np.testing.assert_allclose(found, published, rtol=0.01)


def test_a_slow_test_ends_as_the_drained_one(tmp_path):
    """That of a sand without `hydraulic`, in as many parts."""
    path = triaxial(tmp_path, (0.05,), ", lasts: 10 years, over: 10 years")
    slow = read(path)[:, 0]
    text = path.read_text()
    for line in ("    hydraulic: {permeability: 1e-6 m/s, storage: 1e-12 1/Pa}\n",
                 "time_steps: 1\n", "drained: {x1: {}}\n", ", lasts: 10 years, over: 10 years",
                 text[text.index("  p: {kind") :]):  # fmt: skip
        assert line in text
        text = text.replace(line, "")
    path.write_text(text)
    np.testing.assert_allclose(slow[:2], read(path)[:, 0], rtol=1e-3)
    assert slow[2] == pytest.approx(0.0, abs=1.0)


COLUMN = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
materials:
  clay:
    E: 30 MPa
    nu: 0.2
    hydraulic: {permeability: 1e-9 m/s, storage: 1e-12 1/Pa}
    yield:
      type: hardening-soil
      E50: 10 MPa
      Eoed: 8 MPa
      m: 0.6
      cohesion: 2 kPa
      friction: 28 deg
groups: {all: clay}
supports: {x0: x, x1: x, y0: [x, y]}
drained: {y1: {}}
in_situ: {model: constant, xx: -53 kPa, yy: -100 kPa, zz: -53 kPa}
stages:
  - {name: load, loads: {q: {on: y1, pressure: LOAD}}, lasts: 0 d}
  - {name: wait, lasts: 200 d}
  - {name: end}
gauges:
  S: {kind: settlement, point: [0.2 m, 2 m], accuracy: 0.1 mm}
  p: {kind: piezometer, point: [0.2 m, 0 m], accuracy: 1 kPa}
"""
HEIGHT = 2.0


def column(folder, *changes, cells=8):
    """A layer of clay on rock under a load on all of it."""
    size = (0.5, HEIGHT)
    write_msh(box("quad8", (1, cells), size=size), folder / "m.msh", ["x0", "x1", "y0", "y1"])
    text = COLUMN
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "case.yaml"
    path.write_text(text)
    return path


def test_closed_ground_gives_way_as_much_as_its_water(tmp_path):
    """With air in it: what is stored is what the ground settles, by what its pressure leaves."""
    wait = COLUMN[COLUMN.index("  - {name: wait") : COLUMN.index("gauges:")]
    air = ("storage: 1e-12 1/Pa", "storage: 2e-7 1/Pa")
    s, p = read(column(tmp_path, ("LOAD", "100 kPa"), air, (wait, ""), cells=1))[:, 0]
    assert s == pytest.approx(2e-7 * p * HEIGHT, rel=1e-6)
    assert 30e3 < p < 70e3
    carried = ("LOAD", f"{float(1e5 - p)!r} Pa"), (", lasts: 0 d", "")
    assert s == pytest.approx(read(column(tmp_path, *carried, cells=1))[0, 0], rel=1e-3)


def test_fields_keep_the_pressure_of_every_state(tmp_path):
    """Steps that go on in the same array do not change what was recorded."""
    more = ("wait, lasts: 200 d", "more, loads: {q: {on: y1, pressure: 120 kPa}}, lasts: 0 d")
    path = column(tmp_path, ("LOAD", "100 kPa"), more, ("  - {name: end}\n", ""), cells=1)
    found = simulate(load_case(str(path)), fields=str(tmp_path / "f.vtkhdf")).readings
    with h5py.File(tmp_path / "f.vtkhdf") as file:
        y = file["VTKHDF/Points"][:, 1]
        excess = file["VTKHDF/PointData/excess_pore_pressure"][:].reshape(-1, len(y))
    assert not excess[0].any()
    by_piezometer = [one.value for one in found if one.channel == "p"]
    np.testing.assert_allclose(excess[1:, np.argmin(y)], by_piezometer, rtol=1e-9)
    assert excess[1, np.argmin(y)] < 0.9 * excess[2, np.argmin(y)]


@pytest.mark.slow
def test_a_small_load_consolidates_as_terzaghi_says(tmp_path):
    """The modulus and with it the coefficient of consolidation are those of the stress."""
    moments = [2.0, 8.0, 20.0, 50.0]
    path = column(tmp_path, ("LOAD", "1 kPa"), cells=16)
    s, p = read(path, {"wait": [n * DAY for n in moments]})
    assert abs(s[0]) < 1e-3 * s[-1]
    np.testing.assert_allclose(p[0], 1e3, rtol=1e-3)
    modulus = 1e3 * HEIGHT / s[-1]
    assert modulus == pytest.approx(8e6, rel=0.01)
    T = 1e-9 * modulus / 9807.0 * DAY * np.array([*moments, 200.0]) / HEIGHT**2
    M = 0.5 * np.pi * (2.0 * np.arange(200) + 1.0)[:, None]
    U = 1.0 - (2.0 / M**2 * np.exp(-(M**2) * T)).sum(axis=0)
    at_base = 1e3 * (2.0 * np.sin(M) / M * np.exp(-(M**2) * T)).sum(axis=0)
    np.testing.assert_allclose(s[1:-1] / s[-1], U, atol=0.003)
    np.testing.assert_allclose(p[1:-1], at_base, atol=3.0)


@pytest.mark.slow
@pytest.mark.parametrize("lasts", ["200 d", "150 years"])
def test_a_large_load_settles_in_the_end_as_drained_soil(tmp_path, lasts):
    """Also where the first step in time is longer than the consolidation: nothing swings."""
    path = column(tmp_path, ("LOAD", "100 kPa"), ("200 d", lasts))
    s, p = read(path)
    drained = read(column(tmp_path, ("LOAD", "100 kPa"), (", lasts: 0 d", "")))[0, 0]
    np.testing.assert_allclose(s[1:], drained, rtol=2e-3)
    assert abs(p[1]) < 1e3


SITE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
gravity: 9.81 m/s2
time_steps: 1
parameters:
  E: {start: 40 MPa, bounds: [1 MPa, 300 MPa]}
  E50: {start: 12 MPa, bounds: [1 MPa, 100 MPa]}
  Eoed: {start: 10 MPa, bounds: [1 MPa, 100 MPa]}
  m: {start: 0.7, bounds: [0.1, 1]}
  c: {start: 10 kPa, bounds: [0 kPa, 50 kPa]}
  phi: {start: 28 deg, bounds: [20 deg, 45 deg]}
  OCR: {start: 1.4, bounds: [1, 5]}
  G0: {start: 50 MPa, bounds: [10 MPa, 300 MPa]}
  gamma: {start: 2e-4, bounds: [1e-5, 1e-3]}
  k: {start: 2e-9 m/s, bounds: [1e-10 m/s, 1e-7 m/s]}
  S: {start: 2e-8 1/Pa, bounds: [1e-10 1/Pa, 1e-6 1/Pa]}
  biot: {start: 0.9, bounds: [0.5, 1]}
  q: {start: 30 kPa, bounds: [0 kPa, 100 kPa]}
  head: {start: 1 m, bounds: [0 m, 4 m]}
  push: {start: 3 mm, bounds: [-20 mm, 20 mm]}
  M: {start: 0.5 kNm/m, bounds: [0.01 kNm/m, 100 kNm/m]}
materials:
  clay:
    E: $E
    nu: 0.2
    density: 1900 kg/m3
    hydraulic: {permeability: [2 $k, $k], storage: $S, biot: $biot}
    yield:
      type: hardening-soil
      E50: $E50
      Eoed: $Eoed
      m: $m
      cohesion: $c
      friction: $phi
      dilation: 2 deg
      OCR: $OCR
      G0: $G0
      gamma_07: $gamma
groups: {clay: clay, pit: clay}
supports: {x0: x, x1: x, y0: y}
in_situ: {model: geostatic}
water: {table: 2 m}
structures:
  slab: {kind: beam, on: strip, EA: 20 MN/m, EI: 2 MNm2/m, yield: {M: $M}}
drained: {x0: {}}
stages:
  - {name: slab, build: [slab], lasts: 0 d}
  - {name: load, loads: {q: {on: strip, pressure: $q}}, lasts: 20 d, over: 5 d}
  - {name: dig, excavate: [pit], lasts: 10 d}
  - {name: push, supports: {x1: {x: $push}}, drained: {x0: {head: $head}}, lasts: 10 d}
  - {name: end}
gauges:
  S: {kind: settlement, point: [2 m, 4 m], accuracy: 0.1 mm}
  W: {kind: displacement, component: x, point: [4 m, 3 m], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [2 m, 2.5 m], accuracy: 1 kPa}
"""


def site(folder, text=SITE):
    """A loaded slab that yields on clay beside a pit."""
    mesh = regroup(
        box("quad8", (3, 2), size=(6.0, 4.0)),
        pit=lambda c: (c[:, 1] > 2.0) & (c[:, 0] > 4.0),
        clay=lambda c: c[:, 1] > -1.0,
    )
    top = mesh.points[np.concatenate([facets.nodes for facets in mesh.facets])]
    under = (top[..., 1] > 4.0 - 1e-9) & (top[..., 0] < 3.1)
    mesh.facet_groups["strip"] = np.flatnonzero(under.all(axis=1))
    write_msh(mesh, folder / "m.msh", ["x0", "x1", "y0", "y1", "strip"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


@pytest.mark.slow
def test_derivatives_by_all_constants_are_exact(tmp_path):
    """Undrained, consolidating under a load that grows, with a head, a push, drained at the end."""
    model = model_at(site(tmp_path), {"load": [5 * DAY], "dig": [0.0, 2 * DAY]})
    pairs = [(c.name, s) for c in model.case.channels for s in model.case.stage_names[1:]]
    p = np.array([parameter.start for parameter in model.case.parameters])
    response = model.response(pairs)
    _, jacobian = response.evaluate(p)
    assert (np.abs(jacobian * p).max(axis=0) > 1.0).all()
    # points reach limits within longer steps; shorter ones see how exact the equilibria are
    assert_slopes(response.readings, p, jacobian, model.names, step=2e-5, rtol=1e-6)


@pytest.mark.slow
def test_a_load_that_is_not_carried_is_refused_with_its_moment(tmp_path):
    path = triaxial(tmp_path, (0.001,), "")
    text = path.read_text()
    stages = (
        "  - {name: press, supports: {y1: free}, loads: {q: {on: y1, pressure: 1300 kPa}},"
        " lasts: 10 d, over: 8 d}\n"
    )
    text = text[: text.index("  - {name")] + stages + text[text.index("gauges:") :]
    path.write_text(text)
    model = model_at(path)
    with pytest.raises(
        CollapseError, match=r"days after it began, when .* no equilibrium was"
    ) as e:
        list(model.at(np.zeros(0), RunOptions(derivatives=False)).states())
    assert np.isnan(e.value.fraction)
    assert "beyond" not in str(e.value)
