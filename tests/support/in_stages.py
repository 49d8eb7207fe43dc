"""Cases of ground that consolidates, as files, and their readings at moments of their stages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from geoident.forward.model import StagedModel
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, rows_in
from geoident.model.moments import with_moments
from geoident.workflow.running.jobs import build_model, load_inputs


def write_msh(mesh: Mesh, path: Path, facets: Sequence[str] = ()) -> None:
    """Write a mesh in gmsh's format 2.2, with its groups of elements and some of facets.

    Args:
        mesh: the mesh.
        path: of the file.
        facets: names of groups of facets.
    """
    groups = [(mesh.dim, name, mesh.blocks, mesh.groups[name]) for name in mesh.groups]
    groups += [(mesh.dim - 1, name, mesh.facets, mesh.facet_groups[name]) for name in facets]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(groups))]
    lines += [f'{dim} {n} "{name}"' for n, (dim, name, _, _) in enumerate(groups, 1)]
    lines += ["$EndPhysicalNames", "$Nodes", str(mesh.n_nodes)]
    for n, point in enumerate(mesh.points.tolist(), 1):
        lines.append(" ".join(map(repr, [n, *point, *[0.0] * (3 - mesh.dim)])))
    cells = []
    for tag, (_, _, blocks, members) in enumerate(groups, 1):
        for block, rows in rows_in(blocks, members):
            cell = CELLS[block.kind]
            order = np.argsort(cell.gmsh_order or np.arange(cell.n_nodes))
            cells += [(cell.gmsh, tag, nodes) for nodes in block.nodes[rows][:, order] + 1]
    lines += ["$EndNodes", "$Elements", str(len(cells))]
    for n, (kind, tag, nodes) in enumerate(cells, 1):
        lines.append(" ".join(map(str, (n, kind, 2, tag, tag, *nodes))))
    path.write_text("\n".join([*lines, "$EndElements", ""]))


def model_at(path: Path, moments: Mapping[str, Sequence[float]] = {}, **options) -> StagedModel:
    """The model of a case with states at moments of its stages, s since their beginnings."""
    inputs = load_inputs(str(path), **options)
    loaded = replace(inputs.loaded, case=with_moments(inputs.case, moments))
    model = build_model(replace(inputs, loaded=loaded))
    assert isinstance(model, StagedModel)
    return model


def read(path: Path, moments: Mapping[str, Sequence[float]] = {}, **options) -> np.ndarray:
    """What all channels read (n_channels, n_stages) of all states, at the start values."""
    model = model_at(path, moments, **options)
    start = np.array([parameter.start for parameter in model.case.parameters])
    return model.computed(start)
