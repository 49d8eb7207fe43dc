"""A case for a mesh that is there, to be filled in: groups and numbers of the mesh, no guesses.

What only the engineer knows stands as `BLANK`, so that the case cannot be computed by mistake. What
the mesh suggests (a group on an edge of the model may be a support) stands as a comment.
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Sequence

from geoident.io.case.file import BLANK
from geoident.model.results.summary import MeshSummary, PartSummary

_PLAIN = re.compile(r"(\.\./)*[A-Za-z_/][A-Za-z0-9_./-]*( [A-Za-z0-9_./-]+)*")
_WORDS = {"true", "false", "null", "yes", "no", "on", "off", "y", "n", "~"}
_AXES = "xyz"
_MARGIN = 1e-6
_HEADING = re.compile(r"heading|crown|[ck]alotte", re.IGNORECASE)
_FEW = 2  # elements of a group that is no sliver
_FACETS = {2: "edges", 3: "surfaces"}


def skeleton(mesh: MeshSummary, *, mesh_file: str, title: str) -> str:
    """The text of a case.

    Args:
        mesh: what the mesh holds.
        mesh_file: its path as the case names it.
        title: of the case.
    """
    parts = (
        _head(mesh, mesh_file, title),
        _PARAMETERS,
        _MATERIALS,
        _groups(mesh),
        _supports(mesh),
        _IN_SITU,
        _stages(mesh),
        _gauges(mesh),
        _READINGS,
    )
    return "\n".join(parts)


_PARAMETERS = """\
# What is to be identified; $E_rock refers to it. To fit, write yours below, and delete the {}.
parameters: {}
  # E_rock: {start: 15 GPa, bounds: [2 GPa, 80 GPa], scale: log}
  # K0:     {start: 1.0, bounds: [0.3, 3.0]}
"""
_MATERIALS = f"""\
# The density is that of the ground with its water, saturated below a water table.
materials:
  ground: {{elastic: isotropic, E: {BLANK}, nu: {BLANK}, density: {BLANK}}}
"""
_IN_SITU = f"""\
# In-situ stress of the ground. The vertical is the weight of the layers above, from their densities
# and gravity; K0 is the horizontal in parts of it, one number or one for each group: {{clay: 0.6}}.
gravity: 9.81 m/s2
in_situ: {{model: geostatic, K0: {BLANK}}}
# Where the mesh ends below the surface: surface: 394 m, cover: 26 kN/m3 (what the ground between
# weighs). Far below it a stress that is the same everywhere may do, without gravity:
# in_situ: {{model: heim, vertical: 8 MPa, K0: 1.0}}   # compression positive
# in_situ: {{model: constant, xx: -8 MPa, yy: -6 MPa, zz: -7 MPa, xy: 1 MPa}}   # tension positive
# water: {{table: 0 m}}   # stresses are then effective
"""
_READINGS = """\
# readings: readings.csv   # gauge,stage,value,unit
# fit: {method: gauss-newton, stages: [STAGE]}   # the other stages are predicted
"""


def _head(mesh: MeshSummary, mesh_file: str, title: str) -> str:
    analysis = "solid" if mesh.dim == 3 else "plane-strain"
    kinds = ", ".join(f"{number} {kind}" for kind, number in mesh.kinds)
    lines = [
        f"# A case to be filled in: `geoident check` lists every {BLANK} that is left.",
        "#",
        f"# The mesh has {mesh.nodes} nodes and {mesh.elements} elements ({kinds}).",
        f"#   {_extent(mesh.low, mesh.high)}",
        *(f"#   {line}" for line in textwrap.wrap(mesh.suspicion, 96)),
        "format: geoident-case/1",
        f"title: {name_text(title)}",
        f"analysis: {analysis}",
        f"mesh: {{file: {name_text(mesh_file)}}}",
    ]
    return "\n".join(lines) + "\n"


def _groups(mesh: MeshSummary) -> str:
    lines = ["# What every group of elements is made of at the beginning: a material, or absent."]
    if mesh.ungrouped:
        lines.append(f"# {mesh.ungrouped} elements are in no group: name them in the mesh.")
    if mesh.shared:
        lines.append(
            f"# {mesh.shared} elements are in several groups: keep the groups that share none."
        )
    lines.append("groups:" if mesh.groups else f"groups: {BLANK}")
    for part in mesh.groups:
        lines.append(f"  {name_text(part.name)}: {BLANK} # {_content(part, mesh.dim)}")
    return "\n".join(lines) + "\n"


def _content(part: PartSummary, dim: int) -> str:
    size, unit = part.volume or 0.0, "m3" if dim == 3 else "m2"
    elements = "element" if part.count == 1 else "elements"
    return f"{part.count} {elements}, {size:.6g} {unit}, {_extent(part.low, part.high)}"


def _supports(mesh: MeshSummary) -> str:
    lines = ["# Groups and the directions in which they are fixed. The comments are what the mesh"]
    lines += [
        "# suggests: delete the word after 'supports:', and the # of the lines that are right."
    ]
    lines += [f"supports: {BLANK}"]
    lines += [f"  # {_suggestion(part, mesh)}" for part in mesh.facet_groups]
    lines += [
        f"  # {name_text(p.name)}: {_AXES[p.plane or p.sides or 0]}   # {p.count} nodes"
        for p in mesh.node_groups
    ]
    if not mesh.facet_groups and not mesh.node_groups:
        lines.append(f"  # the mesh names no {_FACETS[mesh.dim]} and no nodes: name them there")
    return "\n".join(lines) + "\n"


def _suggestion(part: PartSummary, mesh: MeshSummary) -> str:
    axis, kind = part.plane, _FACETS[mesh.dim]
    where = f"{part.count} {kind}, {_extent(part.low, part.high)}"
    if part.sides is not None and part.sides < mesh.dim - 1:
        return f"{name_text(part.name)}: {_AXES[part.sides]}   # {where}: both sides of the model"
    if axis is None:
        return f"{name_text(part.name)}   # {where}"
    reach = max(high - low for low, high in zip(mesh.low, mesh.high, strict=True))
    at_low = part.low[axis] <= mesh.low[axis] + _MARGIN * reach
    at_high = part.high[axis] >= mesh.high[axis] - _MARGIN * reach
    if at_high and axis == mesh.dim - 1:
        return f"{name_text(part.name)}   # {where}: the top; free, as a rule"
    if at_low or at_high:
        return f"{name_text(part.name)}: {_AXES[axis]}   # {where}: an edge of the model"
    return f"{name_text(part.name)}   # {where}: inside the model"


def _stages(mesh: MeshSummary) -> str:
    dug = name_text(min(mesh.groups, key=_dug).name) if mesh.groups else "GROUP"
    stage = dug if mesh.groups else "heading"
    return (
        "# Construction, step by step: all changes of one stage happen together.\n"
        f"stages: {BLANK}\n"
        f"  # - {{name: {stage}, excavate: [{dug}]}}\n"
        f"  # - {{name: lining, install: {{{dug}: MATERIAL}}}}\n"
    ) + _walls(mesh)


def _walls(mesh: MeshSummary) -> str:
    """How a wall or lining is written, where a plane mesh has edges inside that could carry it."""
    inner = [p for p in mesh.facet_groups if _suggestion(p, mesh).endswith("inside the model")]
    if mesh.dim != 2 or not inner:
        return ""
    return (
        "\n# Walls and linings are beams on edges; a stage builds them: build: [wall].\n"
        "# Struts, anchors and bolts: `geoident schema --markdown`.\n"
        "# structures:\n"
        f"#   wall: {{kind: beam, on: {name_text(inner[0].name)}, E: 30 GPa, nu: 0.2,"
        " thickness: 0.3 m}\n"
    )


def _dug(part: PartSummary) -> tuple[bool, bool, float]:
    """What is more likely to be excavated first: no sliver, a heading by its name, a small group.

    >>> bool(_HEADING.search("Top-Heading")), bool(_HEADING.search("stope"))
    (True, False)
    """
    return part.count < _FEW, not _HEADING.search(part.name), part.volume or 0.0


def _gauges(mesh: MeshSummary) -> str:
    one, other = (f"[{', '.join(f'{x:.12g} m' for x in point)}]" for point in mesh.inside)
    return (
        "# What is measured; zero is the stage at whose end the gauge is set to zero.\n"
        f"gauges: {BLANK}\n"
        f"  # EX: {{kind: extensometer, head: {one}, anchors: {{a5: {other}}}, accuracy: 0.1 mm,"
        " zero: STAGE}\n"
        f"  # CV: {{kind: convergence, between: [{one}, {other}], accuracy: 0.3 mm, zero: STAGE}}\n"
        f"  # S:  {{kind: settlement, point: {other}, accuracy: 1 mm}}\n"
        f"  # D:  {{kind: displacement, point: {other}, component: x, accuracy: 1 mm}}\n"
    )


def _extent(low: Sequence[float], high: Sequence[float]) -> str:
    """Where a box lies, m; what differs from zero by rounding is zero."""
    reach = max(map(abs, (*low, *high)))
    ends = [[_length(x, reach) for x in (a, b)] for a, b in zip(low, high, strict=True)]
    texts = [
        f"{axis} = {a}" if a == b else f"{axis} {a} .. {b}"
        for axis, (a, b) in zip(_AXES, ends, strict=False)
    ]
    return f"{', '.join(texts)} m"


def _length(x: float, reach: float) -> str:
    return f"{x if abs(x) > 1e-9 * reach else 0.0:.6g}"


def name_text(name: str) -> str:
    """A name as YAML: in quotes where it would not be read as it is.

    >>> name_text("bench-1"), name_text("12"), name_text("no"), name_text("a: b")
    ('bench-1', '"12"', '"no"', '"a: b"')
    """
    plain = _PLAIN.fullmatch(name) and name.lower() not in _WORDS
    return name if plain else json.dumps(name, ensure_ascii=False)
