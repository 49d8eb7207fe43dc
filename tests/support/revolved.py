"""Axisymmetric models put together in code."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from geoident.forward.model import StagedModel
from geoident.model.case import Analysis
from geoident.model.in_situ import ConstantStress
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar
from geoident.model.results.result import FieldSeries
from support.cases import model
from support.meshes import box


def revolve(mesh: Mesh, **changes: Any) -> StagedModel:
    """A staged model of a body of revolution."""
    return model(mesh, analysis=Analysis.AXISYMMETRIC, **changes)


def fields(mesh: Mesh, **changes: Any) -> FieldSeries:
    """Its displacements and stresses in all states."""
    return revolve(mesh, **changes).survey(np.empty(0), fields=True).fields


def constant(rr: float, axial: float, tt: float, shear: float = 0.0) -> ConstantStress:
    """In-situ stress the same everywhere."""
    xx, yy, zz, xy = (Scalar(v) for v in (rr, axial, tt, shear))
    return ConstantStress((xx, yy, zz, xy, Scalar(0.0), Scalar(0.0)))


def section(kind: str, n: tuple[int, int], size: tuple[float, float], *, inner: float) -> Mesh:
    """A rectangle of the r-z plane whose sides are named x0, x1, y0, y1."""
    mesh = box(kind, n, size=size)
    return replace(mesh, points=mesh.points + np.array([inner, 0.0]))
