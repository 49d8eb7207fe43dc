"""The group ``/fields`` of a result: constants that vary from place to place, one group each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter, plain_text
from geoident.model.results.varied import FieldEstimate
from geoident.units import DIMENSIONS

GROUP = "fields"
_TEXTS = ("name", "material", "constant", "dimension", "unit")
_NUMBERS = ("values", "sd", "prior_sd", "reduction")


def write_varied(file: h5py.File, estimates: Sequence[FieldEstimate]) -> None:
    """Writes ``/fields``, if there are any; ``sd`` and ``prior_sd`` are of the logarithm.

    Args:
        file: the result.
        estimates: what is known of each field.
    """
    if not estimates:
        return
    group = file.create_group(GROUP)
    group.attrs["names"] = [plain_text(found.name) for found in estimates]
    for number, found in enumerate(estimates):
        out = TableWriter(
            group, str(number), {"element": found.elements, "axis": ["x", "y", "z"][: _dim(found)]}
        )
        for name in _TEXTS:
            out.group.attrs[name] = plain_text(getattr(found, name))
        for name in ("modes", "tests"):
            out.group.attrs[name] = np.int64(getattr(found, name))
        out.group.attrs["explained"] = np.float64(found.explained)
        out.add("centre", found.centres, "element", "axis", unit="m")
        for name in _NUMBERS:
            unit = DIMENSIONS.get(found.dimension, "") if name == "values" else ""
            out.add(name, getattr(found, name), "element", unit=unit)


def _dim(found: FieldEstimate) -> int:
    return int(found.centres.shape[1])


def read_varied(file: h5py.File) -> tuple[FieldEstimate, ...]:
    """The fields as they were written."""
    group = file[GROUP]
    estimates = []
    for number in range(len(group.attrs["names"])):
        table = TableReader(group, str(number))
        elements = table.array("element", "iu").astype(np.int64)
        n, dim = len(elements), len(table.texts("axis"))
        found: dict[str, Any] = {name: table.attribute(name, str) for name in _TEXTS}
        found |= {name: table.floats(name, n) for name in _NUMBERS}
        found |= {name: table.attribute(name, int) for name in ("modes", "tests")}
        estimates.append(
            FieldEstimate(
                **found,
                elements=elements,
                centres=table.floats("centre", n, dim),
                explained=table.attribute("explained", float),
            )
        )
    return tuple(estimates)
