"""What interfaces bear before they slip or part, and what comes back as a gap closes (theory 5.15).

A point of an interface has the tractions s = (t_n, t_s), two t_s in a solid, and Coulomb's limit

    |t_s| + t_n tan phi <= c ,    t_n <= f_t ,

in every direction along the face; slip opens it by the dilation.
"""

from __future__ import annotations

import numpy as np

from geoident.fem.yielding.coulomb_cone import ConeLimits, CoulombCone
from geoident.forward.structures.members import rigidities
from geoident.model.arrays import Floats
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.interfaces import Interface
from geoident.model.parameter import Scalar


def coulomb_cone(interface: Interface, point: ParameterPoint, n_slips: int) -> CoulombCone:
    """The limits of an interface that yields, with derivatives by all its constants.

    Args:
        interface: it yields.
        point: the parameters.
        n_slips: number of t_s.
    """
    assert interface.friction is not None
    none, part = point.constant(0.0), point.constant(1.0)
    if interface.R_inter is not None:
        part = point.number(interface.R_inter)
    cohesion = none if interface.cohesion is None else point.number(interface.cohesion)
    limits = ConeLimits(
        part * cohesion,
        part * _tangent(point.number(interface.friction)),
        _tangent(point.number(interface.dilation)),
        point.number(interface.tensile_strength),
    )
    stiff, soft = point.number(interface.k_n), point.number(interface.k_s)
    return CoulombCone(stiff, soft, limits, n_slips)


def as_it_closes(interface: Interface, point: ParameterPoint, plastic: Floats) -> Floats:
    """Normal tractions (n, 1 + n + k), Pa, that come back as an interface closes.

    Plastic opening is a gap, which closes again, but for what slip dilates.

    Args:
        interface: it yields.
        point: the parameters.
        plastic: (dim, n, 1 + n + k) elastic tractions of a step less those at its end, Pa.
    """
    normal, shears = plastic[0], plastic[1:]
    if interface.dilation == Scalar(0.0):
        return np.asarray(normal)
    stiff, soft = rigidities(interface, point)
    opens = _tangent(point.number(interface.dilation)) * stiff / soft  # by the slip, as tractions
    size = np.linalg.norm(shears[..., 0], axis=0)
    slip = np.einsum("sn,snc->nc", shears[..., 0] / np.where(size > 0.0, size, 1.0), shears)
    back = normal - float(opens.value) * slip
    back[:, 1 : point.n_columns] -= np.outer(size, opens.columns[1:])
    return np.asarray(back)


def _tangent(angle: Dual) -> Dual:
    return angle.sine() / angle.cosine()
