"""Hardening soil whose water takes time: undrained, consolidating, in the end drained."""

import numpy as np
import pytest
from support.derivatives import assert_slopes
from support.in_stages import model_at, read, write_msh
from support.meshes import box, regroup

from geoident.errors import CollapseError
from geoident.forward.analysis.analysis import RunOptions

DAY, YEAR = 86400.0, 365.25 * 86400.0

TRIAXIAL = """\
format: geoident-case/1
analysis: axisymmetric
mesh: {{file: m.msh}}
time_steps: 3
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
    strains = (0.002, 0.01, 0.04, 0.076, 0.1)
    yy, xx, p = read(triaxial(tmp_path, strains, ", lasts: 0 d"))
    np.testing.assert_allclose(xx, -300e3, rtol=1e-6)
    assert p.max() / 300e3 == pytest.approx(0.555, rel=0.01)
    assert p[3] == pytest.approx(p.max(), rel=1e-4)
    mean = -(yy + 2.0 * xx) / 3.0 - p
    found = np.array([mean[-1], (xx - yy)[-1], p.max()])
    published = np.array([246e3, 339e3, 0.555 * 300e3])
    verification("undrained-triaxial", "", [0, 1, 2], exact=published, found=found)
    np.testing.assert_allclose(found, published, rtol=0.01)
