"""One element of hardening soil whose edges move: a specimen in the laboratory."""

from support.in_stages import write_msh
from support.meshes import box

CASE = """\
format: geoident-case/1
analysis: {analysis}
mesh: {{file: m.msh}}
{parameters}
materials:
  sand: {{E: {E}, nu: {nu}, yield: {{type: hardening-soil, {law}}}}}
groups: {{all: sand}}
supports: {{x0: x, y0: y, y1: y{held}}}
in_situ: {{model: constant, xx: {side} Pa, yy: {upright} Pa, zz: {side} Pa}}
stages:
{stages}
gauges:
  yy: {{kind: stress, point: [0.4 m, 0.55 m], components: [yy], accuracy: 1 kPa}}
  xx: {{kind: stress, point: [0.4 m, 0.55 m], components: [xx], accuracy: 1 kPa}}
  S: {{kind: displacement, point: [1 m, 0.5 m], component: x, accuracy: 1 mm}}
"""


def element(folder, law, supports, *, side, upright=None, held="", **changes):
    """One element of sand whose edges move as the stages say; the case file."""
    analysis = changes.pop("analysis", "axisymmetric")
    write_msh(box("quad8", (1, 1), size=(1.0, 1.0)), folder / "m.msh", ["x0", "x1", "y0", "y1"])
    stages = "\n".join(
        f"  - {{name: stage {n}, supports: {{{text}}}}}" for n, text in enumerate(supports, 1)
    )
    values = {"E": "60 MPa", "nu": "0.2", "parameters": "", **changes}
    text = CASE.format(
        law=law, stages=stages, side=-side, upright=-(upright or side), held=held,
        analysis=analysis, **values,
    )  # fmt: skip
    path = folder / "case.yaml"
    path.write_text(text)
    return path


def pressed(*strains):
    """Supports that press the upper edge to strains."""
    return [f"y1: {{y: {-1e3 * float(strain)!r} mm}}" for strain in strains]
