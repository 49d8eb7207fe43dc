"""What is known of the yield planes in a result file: ``/certificate``, SI."""

from __future__ import annotations

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter, plain_text
from geoident.model.yielding import Activity, Certificate

GROUP = "certificate"
_NUMBERS = ("gradient", "bound", "gap")


def write_certificate(file: h5py.File, found: Certificate, names: tuple[str, ...]) -> None:
    """Writes ``/certificate``, one row a yield plane.

    The kind of stationary point, the gradient and the proven bound are attributes.

    Args:
        file: the result.
        found: the certificate.
        names: of the parameters.
    """
    activity = found.activity
    axes = {
        "plane": activity.planes,
        "stage": activity.stages,
        "parameter": names,
        "bounded": tuple(found.lower_bounds),
        "remark": found.remarks,
    }
    out = TableWriter(file, GROUP, axes)
    out.add("points", np.asarray(activity.points, dtype=np.int64), "plane", "stage")
    out.add("biactive", np.asarray(activity.biactive, dtype=np.int64), "plane", "stage")
    out.add("distance", activity.distances, "plane", unit="Pa")
    out.add("reached", activity.reached, "plane", unit="Pa")
    unit = "Pa per SI unit of the parameter"
    out.add("slope", activity.slopes, "plane", "parameter", unit=unit)
    least = np.array([*found.lower_bounds.values()], dtype=np.float64)
    out.add("at_least", least, "bounded", unit="SI unit of the parameter")
    out.group.attrs["kind"] = plain_text(found.kind)
    for name in _NUMBERS:
        out.group.attrs[name] = np.float64(getattr(found, name))


def read_certificate(file: h5py.File) -> Certificate:
    """The certificate."""
    group = TableReader(file, GROUP)
    planes, stages, names = (group.texts(axis) for axis in ("plane", "stage", "parameter"))
    shape = len(planes), len(stages)
    bounded = group.texts("bounded")
    least = group.floats("at_least", len(bounded))
    activity = Activity(
        planes=planes,
        stages=stages,
        points=group.ints("points", *shape),
        biactive=group.ints("biactive", *shape),
        distances=group.floats("distance", len(planes)),
        reached=group.floats("reached", len(planes)),
        slopes=group.floats("slope", len(planes), len(names)),
    )
    return Certificate(
        kind=group.attribute("kind", str),
        gradient=group.attribute("gradient", float),
        activity=activity,
        lower_bounds=dict(zip(bounded, map(float, least), strict=True)),
        bound=group.attribute("bound", float),
        gap=group.attribute("gap", float),
        remarks=group.texts("remark"),
    )
