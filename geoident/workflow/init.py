"""``geoident init``: a case to begin with."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from geoident.errors import OutputError, Term
from geoident.fem.kinematics import kinematics_of
from geoident.fem.measure import summarize_mesh
from geoident.io.docs.case_schema import case_schema_text
from geoident.io.docs.skeleton import skeleton
from geoident.io.docs.templates import template_files
from geoident.io.mesh.file import mesh_files, read_mesh
from geoident.io.text.atomic import atomic_output, make_folder, refuse_inputs
from geoident.io.text.text_file import seen_from
from geoident.model.case import Analysis

CASE = "case.yaml"
SCHEMA = "case.schema.json"


def init_template(name: str, folder: str, *, force: bool, schema: bool = False) -> tuple[str, ...]:
    """Write a template into a folder: the case, its mesh with the geometry, its readings.

    Args:
        name: of the template.
        folder: where to write.
        force: replace files of these names.
        schema: write the JSON schema of cases beside it, by which editors complete keys.

    Returns:
        The files, the case first.

    Raises:
        OutputError: files of these names exist, or cannot be written.
    """
    return _write(template_files(name), folder, force=force, schema=schema, inputs=())


def init_from_mesh(
    mesh_path: str, folder: str, *, force: bool, schema: bool = False
) -> tuple[str, ...]:
    """Write a case that is to be filled in for a mesh, which stays where it is.

    Args:
        mesh_path: of the mesh.
        folder: where to write.
        force: replace files of these names.
        schema: write the JSON schema of cases beside it, by which editors complete keys.

    Returns:
        The files, the case first.

    Raises:
        InputError: the mesh cannot be read.
        OutputError: files of these names exist, or cannot be written.
    """
    mesh = read_mesh(mesh_path, dim=None)
    analysis = Analysis.SOLID if mesh.dim == 3 else Analysis.PLANE_STRAIN
    text = skeleton(
        summarize_mesh(mesh, kinematics_of(analysis)),
        mesh_file=seen_from(Path(folder), mesh_path),
        title=Path(mesh_path).stem,
    )
    inputs = mesh_files(mesh_path)
    return _write({CASE: text.encode()}, folder, force=force, schema=schema, inputs=inputs)


def _write(
    contents: Mapping[str, bytes], folder: str, *, force: bool, schema: bool, inputs: Sequence[str]
) -> tuple[str, ...]:
    """Write files into a folder, made if it is missing; none if one of them is there already."""
    if schema:
        first = f"# yaml-language-server: $schema={SCHEMA}\n#\n".encode()
        contents = {**contents, CASE: first + contents[CASE], SCHEMA: case_schema_text().encode()}
    names = sorted(contents, key=lambda name: (name != CASE, name))
    paths = {name: Path(folder) / name for name in names}
    existing = [str(path) for path in paths.values() if os.path.lexists(path)]
    if existing and not force:
        raise OutputError(
            f"{', '.join(existing)}: exists already; nothing was written\n"
            f"    name another folder, or overwrite with {Term.FORCE}"
        )
    make_folder(folder)
    for path in paths.values():
        refuse_inputs(path, inputs)
    for name, path in paths.items():
        with atomic_output(path, overwrite=force, inputs=inputs) as temporary:
            Path(temporary).write_bytes(contents[name])
    return tuple(str(path) for path in paths.values())
