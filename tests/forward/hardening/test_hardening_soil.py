"""Hardening soil: laboratory tests on one element, in closed form and as published; derivatives.

Loose Hostun sand: Schanz, Vermeer & Bonnier (1999), table 1; the numbers of its tests are those of
the report of ConstitutiveModels (github.com/PlatypusBytes), which follow from that table.
"""

import numpy as np
import pytest
from support.derivatives import assert_slopes
from support.in_stages import model_at, read, write_msh
from support.meshes import box, regroup
from support.specimen import element, pressed

from geoident.errors import CollapseError
from geoident.forward.analysis.analysis import RunOptions

HOSTUN = "E50: 20 MPa, m: 0.65, cohesion: 0 kPa, friction: 34 deg"
CAP = ", Eoed: 16 MPa, K0nc: 0.4408"
PHI = np.radians(34.0)
STRENGTH = 2.0 * np.sin(PHI) / (1.0 - np.sin(PHI))


def test_drained_triaxial_test_is_the_hyperbola_and_unloads_by_the_given_modulus(
    tmp_path, verification
):
    cell = 300e3
    at_half, E_i = 20e6 * 3.0**0.65, 2.0 * 20e6 * 3.0**0.65 / (2.0 - 0.9)
    q = STRENGTH * cell * np.array([0.5, 0.9])
    strains = q / (E_i * (1.0 - 0.9 * q / (STRENGTH * cell)))
    assert strains[0] == pytest.approx(q[0] / at_half)
    path = element(tmp_path, HOSTUN, pressed(*strains, strains[1] - 1e-3, 0.2), side=cell)
    yy, xx, _ = read(path)
    verification("hardening-triaxial", "", 100.0 * strains, exact=q, found=(xx - yy)[:2])
    np.testing.assert_allclose(xx, -cell, rtol=1e-8)
    np.testing.assert_allclose((xx - yy)[:2], q, rtol=5e-4)
    assert (yy[2] - yy[1]) / 1e-3 == pytest.approx(60e6 * 3.0**0.65, rel=1e-6)
    assert yy[3] / xx[3] == pytest.approx(3.537, abs=5e-4)


def test_first_loading_in_the_oedometer_has_its_modulus_and_ratio(tmp_path, verification):
    stress = np.array([20e3, 50e3, 100e3, 200e3])
    strains = 1e5 / (16e6 * 0.35) * ((stress / 1e5) ** 0.35 - 0.02**0.35)
    assert strains[-1] == pytest.approx(0.01821, abs=1e-5)
    path = element(
        tmp_path, HOSTUN + CAP, pressed(*strains), side=0.4408 * 2e3, upright=2e3, held=", x1: x"
    )
    yy, xx, _ = read(path)
    verification("hardening-oedometer", "", 100.0 * strains, exact=stress, found=-yy)
    np.testing.assert_allclose(-yy, stress, rtol=0.003)
    np.testing.assert_allclose(xx[1:] / yy[1:], 0.441, rtol=0.01)


@pytest.mark.slow
def test_a_cube_in_space_is_the_same_as_the_specimen_about_an_axis(tmp_path):
    """Two of its principal stresses are equal at all times."""
    cell, strains = 300e3, (0.002, 0.01, 0.03)
    section, cube = tmp_path / "section", tmp_path / "cube"
    section.mkdir()
    cube.mkdir()
    yy, xx, _ = read(element(section, HOSTUN + CAP, pressed(*strains), side=cell))
    write_msh(box("hex8", (1, 1, 1)), cube / "m.msh", ["x0", "y0", "z0", "z1"])
    steps = "\n".join(
        f"  - {{name: stage {n}, supports: {{z1: {{z: {-1e3 * strain!r} mm}}}}}}"
        for n, strain in enumerate(strains, 1)
    )
    (cube / "case.yaml").write_text(f"""\
format: geoident-case/1
analysis: solid
mesh: {{file: m.msh}}
materials:
  sand: {{E: 60 MPa, nu: 0.2, yield: {{type: hardening-soil, {HOSTUN}{CAP}}}}}
groups: {{all: sand}}
supports: {{x0: x, y0: y, z0: z, z1: z}}
in_situ: {{model: constant, xx: {-cell} Pa, yy: {-cell} Pa, zz: {-cell} Pa}}
stages:
{steps}
gauges:
  zz: {{kind: stress, point: [0.4 m, 0.5 m, 0.6 m], components: [zz], accuracy: 1 kPa}}
  xx: {{kind: stress, point: [0.4 m, 0.5 m, 0.6 m], components: [xx], accuracy: 1 kPa}}
""")
    upright, across = read(cube / "case.yaml")
    np.testing.assert_allclose(across, -cell, rtol=1e-6)
    np.testing.assert_allclose(upright, yy, rtol=1e-6)
    np.testing.assert_allclose(xx, -cell, rtol=1e-6)


SUBMERGED = """\
format: geoident-case/1
analysis: plane-strain
mesh: {{file: m.msh}}
materials:
  sand:
    {{E: 60 MPa, nu: 0.2, density: {density} kg/m3, yield: {{type: hardening-soil, {law}}}}}
groups: {{all: sand}}
supports: {{x0: x, x1: x, y0: [x, y]}}
gravity: 9.81 m/s2
in_situ: {{model: geostatic, K0: 0.5, surface: 5 m}}
{water}
stages:
  - {{name: load, loads: {{q: {{on: y1, pressure: 100 kPa}}}}}}
gauges:
  S: {{kind: settlement, point: [1 m, 5 m], accuracy: 0.1 mm}}
"""


@pytest.mark.slow
def test_water_at_rest_leaves_the_effective_stress(tmp_path):
    """A submerged layer settles as one without water of the weight under water."""
    law = "E50: 20 MPa, Eoed: 16 MPa, m: 0.65, cohesion: 1 kPa, friction: 34 deg"
    write_msh(box("quad8", (2, 5), size=(2.0, 5.0)), tmp_path / "m.msh", ["x0", "x1", "y0", "y1"])
    found = []
    for density, water in ((2000, "water: {table: 5 m}"), (1000, "")):
        path = tmp_path / f"{density}.yaml"
        path.write_text(SUBMERGED.format(density=density, law=law, water=water))
        found.append(read(path).item())
    assert found[0] == pytest.approx(found[1], rel=1e-8)
    assert found[0] == pytest.approx(0.0426, rel=0.01)


@pytest.mark.slow
def test_the_cap_softens_a_drained_triaxial_test_as_published(tmp_path):
    path = element(
        tmp_path, HOSTUN + CAP, pressed(0.5 * STRENGTH * 300e3 / 33.45e6, 0.108), side=300e3
    )
    yy, xx, u = read(path)
    assert xx[0] - yy[0] == pytest.approx(0.5 * STRENGTH * 300e3, rel=0.01)
    assert yy[1] / xx[1] == pytest.approx(3.537, rel=0.002)
    assert 0.108 - 2.0 * u[1] == pytest.approx(0.0097, rel=0.01)


@pytest.mark.slow
def test_dense_sand_in_the_triaxial_test_is_that_of_another_program(tmp_path):
    """Points of numgeo's own example (numgeo-hardening-soil-bricks, BSD 3-Clause, J. Machacek).

    Its first strain step of 5e-4 steps over what is stiff at small strains; E_i is 65.5 MPa there.
    """
    strains = np.array([0.001, 0.003, 0.01, 0.02, 0.035])
    q = 1e3 * np.array([47.643, 115.972, 247.177, 328.600, 377.203])
    path = element(
        tmp_path,
        "E50: 36.025 MPa, Eoed: 30 MPa, K0nc: 0.4, m: 0.55, cohesion: 0 kPa, friction: 42 deg, "
        "dilation: 16 deg",
        pressed(*strains), side=100e3, E="90 MPa", nu="0.25",
    )  # fmt: skip
    yy, xx, _ = read(path)
    np.testing.assert_allclose(xx - yy, q, rtol=0.025)


@pytest.mark.slow
@pytest.mark.parametrize(("cell", "p", "q"), [(300e3, 246e3, 339e3), (600e3, 493e3, 677e3)])
def test_undrained_triaxial_test_ends_as_published(tmp_path, cell, p, q):
    """All edges move so that the volume stays: what is left is the effective stress."""
    steps = [f"y1: {{y: -{e} mm}}, x1: {{x: {0.5 * e} mm}}" for e in (2.0, 10.0, 40.0, 100.0)]
    yy, xx, _ = read(element(tmp_path, HOSTUN + CAP, steps, side=cell, held=", x1: x"))
    assert -(yy[-1] + 2.0 * xx[-1]) / 3.0 == pytest.approx(p, rel=0.01)
    assert xx[-1] - yy[-1] == pytest.approx(q, rel=0.01)


@pytest.mark.slow
def test_overconsolidated_soil_reloads_to_its_past_stress(tmp_path):
    """By OCR or by POP alike: stiff up to the stress of the past, then with Eoed."""
    both = []
    for past in ("OCR: 4", "POP: 150 kPa"):
        path = element(
            tmp_path, f"{HOSTUN}{CAP}, {past}", pressed(5e-4, 0.015), side=30e3, upright=50e3,
            held=", x1: x",
        )  # fmt: skip
        both.append(read(path))
    np.testing.assert_allclose(both[0], both[1], rtol=1e-9)
    yy = -both[0][0]
    young = element(tmp_path, HOSTUN + CAP, pressed(5e-4), side=30e3, upright=50e3, held=", x1: x")
    assert yy[0] - 50e3 > 1.5 * (-read(young)[0, 0] - 50e3)
    slope = 16e6 * (0.5 * (200e3 + yy[1]) / 1e5) ** 0.65
    stiff = 200e3 - 50e3
    assert yy[1] > 200e3
    assert yy[1] - 200e3 < slope * 0.015
    assert stiff < yy[1] - 50e3


def test_no_equilibrium_beyond_the_strength(tmp_path):
    path = element(tmp_path, HOSTUN, pressed(1e-3), side=300e3)
    load = "  - {name: press, supports: {y1: free}, loads: {top: {pressure: 1200 kPa, on: y1}}}"
    text = path.read_text()
    path.write_text(text[: text.index("  - {name")] + load + text[text.index("\ngauges") :])
    model = model_at(path)
    with pytest.raises(CollapseError, match="no equilibrium was found beyond"):
        list(model.at(np.zeros(0), RunOptions(derivatives=False)).states())


SHEARED = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
gravity: 9.81 m/s2
parameters:
  E: {start: 75 MPa, bounds: [1 MPa, 300 MPa]}
  nu: {start: 0.2, bounds: [0, 0.4]}
  E50: {start: 25 MPa, bounds: [1 MPa, 100 MPa]}
  Eoed: {start: 22 MPa, bounds: [1 MPa, 100 MPa]}
  m: {start: 0.5, bounds: [0.1, 1]}
  p_ref: {start: 100 kPa, bounds: [50 kPa, 200 kPa]}
  Rf: {start: 0.9, bounds: [0.5, 0.95]}
  c: {start: 3 kPa, bounds: [0 kPa, 50 kPa]}
  phi: {start: 33 deg, bounds: [20 deg, 45 deg]}
  psi: {start: 6 deg, bounds: [0 deg, 10 deg]}
  K0nc: {start: 0.47, bounds: [0.3, 0.7]}
  OCR: {start: 1.2, bounds: [1, 5]}
  POP: {start: 5 kPa, bounds: [0 kPa, 50 kPa]}
  G0: {start: 100 MPa, bounds: [50 MPa, 300 MPa]}
  gamma: {start: 2e-4, bounds: [1e-5, 1e-3]}
  E_w: {start: 400 MPa, bounds: [100 MPa, 1 GPa]}
  p: {start: 70 kPa, bounds: [0 kPa, 500 kPa]}
  K0: {start: 0.6, bounds: [0.3, 1]}
materials:
  sand:
    E: $E
    nu: $nu
    density: 1900 kg/m3
    yield:
      type: hardening-soil
      E50: $E50
      Eoed: $Eoed
      m: $m
      p_ref: $p_ref
      Rf: $Rf
      cohesion: $c
      friction: $phi
      dilation: $psi
      tension: 1 kPa
      K0nc: $K0nc
      OCR: $OCR
      POP: $POP
      G0: $G0
      gamma_07: $gamma
  concrete: {E: $E_w, nu: 0.2, density: 1900 kg/m3}
groups: {pit: sand, wall: sand, rock: sand}
supports: {x0: x, x1: x, y0: fixed}
in_situ: {model: geostatic, K0: $K0}
stages:
  - {name: wall, install: {wall: concrete}, loads: {top: {pressure: $p, on: y1}}}
  - {name: pit, excavate: [pit], remove: [top]}
gauges:
  S: {kind: settlement, point: [8 m, 5 m], accuracy: 1 mm}
  W: {kind: displacement, point: [3 m, 6 m], component: x, accuracy: 1 mm}
  T: {kind: stress, point: [5 m, 4 m], components: [xy], accuracy: 1 kPa}
"""


@pytest.mark.slow
def test_derivatives_by_all_constants_go_exactly_through_the_stages(tmp_path):
    mesh = regroup(
        box("quad8", (4, 3), size=(8.0, 6.0)),
        pit=lambda c: (c[:, 0] < 2.0) & (c[:, 1] > 4.0),
        wall=lambda c: (c[:, 0] < 4.0) & (c[:, 0] > 2.0) & (c[:, 1] > 2.0),
    )
    write_msh(mesh, tmp_path / "m.msh", ["x0", "x1", "y0", "y1"])
    path = tmp_path / "case.yaml"
    path.write_text(SHEARED)
    model = model_at(path)
    start = np.array([parameter.start for parameter in model.case.parameters])

    def readings(p, *, derivatives=False):
        run = model.at(p, RunOptions(derivatives=derivatives))
        seen = np.stack([model.see(end, run) for end in run.states()][1:])
        return seen.reshape(-1, seen.shape[2]) if derivatives else seen[..., 0].ravel()

    end = readings(start, derivatives=True)
    assert (np.abs(end[:, 1:]).max(axis=0) > 0.0).all()
    jacobian = end[:, 1:]
    assert_slopes(readings, start, jacobian, model.names, step=3e-4, rtol=1e-7)
