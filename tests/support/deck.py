"""Meshes as Abaqus decks, with their groups of elements and the nodes of their faces."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geoident.model.mesh import Mesh, rows_in, spans

_TYPES = {"tri3": "CPE3", "tri6": "CPE6", "quad4": "CPE4", "quad8": "CPE8", "hex8": "C3D8"}


def write_deck(mesh: Mesh, path: Path) -> None:
    """Write a mesh; groups of lines become sets of nodes."""
    lines = ["*NODE"]
    for n, point in enumerate(mesh.points.tolist(), start=1):
        lines.append(", ".join([str(n), *map(repr, point), *["0"] * (3 - mesh.dim)]))
    for block, span in spans(mesh.blocks):
        lines.append(f"*ELEMENT, TYPE={_TYPES[block.kind]}")
        for n, nodes in enumerate(block.nodes + 1, start=span.start + 1):
            lines.append(", ".join(map(str, (n, *nodes))))
    for name, members in mesh.groups.items():
        lines += [f"*ELSET, ELSET={name}", *(str(n + 1) for n in members)]
    for name, members in mesh.facet_groups.items():
        found = [block.nodes[rows].ravel() for block, rows in rows_in(mesh.facets, members)]
        lines += [f"*NSET, NSET={name}", *(str(n + 1) for n in np.unique(np.concatenate(found)))]
    path.write_text("\n".join(lines) + "\n")
