"""The group ``/reduced`` of a result: a reduced model that answers without the mesh.

Its many small arrays stand one after the other in ``numbers``, in rows, with ``block`` and
``shape`` to find them: thousands of datasets would take longer to open than to compute with.
"""

from __future__ import annotations

from io import BytesIO
from typing import Any

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter, plain_text
from geoident.model.arrays import Floats
from geoident.model.results.reduced import KeptReducedModel

GROUP = "reduced"
_MOST_AXES = 4
_ABSENT = -1
_OF_PARAMETERS = ("reference", "lower", "upper")


def write_reduced(file: h5py.File, kept: KeptReducedModel) -> None:
    """Writes ``/reduced``.

    Args:
        file: the result.
        kept: the model.
    """
    blocks = kept.blocks
    axes: dict[str, Any] = {
        "parameter": kept.names,
        "march": np.arange(1, 1 + len(kept.analyses)),
        "material": kept.materials,
        "gauge": kept.channels,
        "state": np.arange(len(kept.readable)),
        "reading": np.arange(len(kept.rows)),
        "part": ("stage", "zero"),
        "block": tuple(blocks),
        "axis": np.arange(_MOST_AXES),
    }
    out = TableWriter(file, GROUP, axes)
    out.group.attrs["form"] = plain_text(kept.form)
    for name in _OF_PARAMETERS:
        out.add(name, getattr(kept, name), "parameter")
    out.add("marches", kept.analyses, "march", "parameter")
    out.add("weights", kept.weights, "part", "gauge")
    out.add("zero", kept.zero, "gauge")
    out.add("readable", kept.readable, "state", "gauge")
    out.group.create_dataset("built_on", data=kept.built_on.astype(np.int8))
    out.add("row", kept.rows, "reading")
    out.add("of_state", kept.states, "reading")
    shapes = np.full((len(blocks), _MOST_AXES), _ABSENT, dtype=np.int64)
    for shape, block in zip(shapes, blocks.values(), strict=True):
        shape[: block.ndim] = block.shape
    out.add("shape", shapes, "block", "axis")
    numbers = [np.zeros(0), *(block.ravel() for block in blocks.values())]
    out.group.create_dataset("numbers", data=np.concatenate(numbers))


def read_reduced(file: h5py.File) -> KeptReducedModel:
    """The reduced model as it was written."""
    group = TableReader(file, GROUP)
    names, channels = group.texts("parameter"), group.texts("gauge")
    n, c = len(names), len(channels)
    analyses, states = (len(group.array(axis, "iu")) for axis in ("march", "state"))
    readings = len(group.array("reading", "iu"))
    columns: dict[str, Any] = {name: group.floats(name, n) for name in _OF_PARAMETERS}
    return KeptReducedModel(
        form=group.attribute("form", str),
        names=names,
        analyses=group.floats("marches", analyses, n),
        materials=group.texts("material"),
        channels=channels,
        weights=group.floats("weights", len(group.texts("part")), c),
        zero=group.ints("zero", c),
        readable=group.bools("readable", states, c),
        built_on=group.bools("built_on", states, states),
        rows=group.ints("row", readings),
        states=group.ints("of_state", readings),
        blocks=_blocks(group),
        **columns,
    )


def _blocks(group: TableReader) -> dict[str, Floats]:
    names = group.texts("block")
    shapes = [
        tuple(size for size in row if size != _ABSENT)
        for row in group.ints("shape", len(names), len(group.array("axis", "iu"))).tolist()
    ]
    sizes = [int(np.prod(shape)) for shape in shapes]
    numbers = group.floats("numbers", sum(sizes))
    parts = np.split(numbers, np.cumsum(sizes)[:-1]) if sizes else []
    return {
        name: part.reshape(shape) for name, part, shape in zip(names, parts, shapes, strict=True)
    }


def reduced_bytes(kept: KeptReducedModel) -> bytes:
    """A reduced model as a file of its own: for a checkpoint."""
    content = BytesIO()
    with h5py.File(content, "w") as file:
        write_reduced(file, kept)
    return content.getvalue()


def reduced_from_bytes(content: bytes) -> KeptReducedModel:
    """The reduced model that `reduced_bytes` made a file of."""
    with h5py.File(BytesIO(content), "r") as file:
        return read_reduced(file)
