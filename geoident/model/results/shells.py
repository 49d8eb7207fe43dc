"""What shells bear, face by face and stage by stage."""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.results.columns import VIEWS, Record, column, derived

_N = {"dimension": "line load", "unit": "N/m", "shown": "kN/m"}
_M = {"dimension": "moment per length", "unit": "N m/m", "shown": "kNm/m"}
_ANGLE = {"dimension": "angle", "shown": "deg", "hidden": ("diff",)}


SECTIONS = ("along axis 1", "along axis 2", "in the worst direction")
"""Directions of N in the sections of a shell that are held against its strength."""


class ShellForces(Record):
    """Forces in shells, means over the faces of the mesh; NaN while a shell does not stand.

    Args:
        structures: (n_faces,) name of the shell of each face.
        numbers: (n_faces,) its number within the shell, from 1.
        stages: names of the stages, the virgin state not among them.
        centres: (n_faces, 3) middles of the faces, m.
        corners: (n_faces, 4, 3) of the faces in their order, m; the fourth of a triangle is NaN.
        axes: (n_faces, 3, 3) unit vectors: axes 1 and 2 of the forces, and the normal to the
            inside.
        normal: (n_faces, 3, n_stages) n_11, n_22, n_12, N per metre, tension positive.
        moment: (n_faces, 3, n_stages) m_11, m_22, m_12, N m per metre, positive with tension on
            the inside.
        utilisation: (n_faces, 3, n_stages) the part of its strength that n and m use together
            along axis 1, along axis 2 and in the direction in which it is most; 1 at the limit,
            infinite where no strength could bear them. NaN where no strength is given; None where
            none of any is.
        used_angle: (n_faces, n_stages) that direction: angle from axis 1 towards axis 2, rad.
    """

    structures: tuple[str, ...] = column("face", name="structure")
    numbers: Ints = column("face", name="number")
    stages: tuple[str, ...] = column("stage", name="stage")
    centres: Floats = column(
        "face", "axis", name="points", title="centre", sheet="{axis}", dimension="length", shown="m"
    )
    corners: Floats = column("face", "corner", "axis", hidden=VIEWS)
    axes: Floats = column("face", "shell_axis", "axis", name="axes", hidden=VIEWS)
    normal: Floats = column(
        "face", "shell_part", "stage", name="n", sheet="n_{shell_part}", like=_N
    )
    moment: Floats = column(
        "face", "shell_part", "stage", name="m", sheet="m_{shell_part}", like=_M
    )

    utilisation: Floats | None = column(
        "face", "section", "stage", default=None, sheet="used_{section}", unit="1", optional=True
    )
    used_angle: Floats | None = column(
        "face", "stage", default=None, dimension="angle", shown="deg", optional=True
    )

    @property
    @derived("face", "principal", "stage", sheet="n_{principal}", hidden=("diff",), **_N)
    def n_principal(self) -> Floats:
        """The larger and the smaller principal normal force, N/m."""
        return principal(self.normal)[0]

    @property
    @derived("face", "stage", **_ANGLE)
    def n_angle(self) -> Floats:
        """Direction of the larger one: angle from axis 1 towards axis 2, rad."""
        return principal(self.normal)[1]

    @property
    @derived("face", "principal", "stage", sheet="m_{principal}", hidden=("diff",), **_M)
    def m_principal(self) -> Floats:
        """The larger and the smaller principal moment, N m/m."""
        return principal(self.moment)[0]

    @property
    @derived("face", "stage", **_ANGLE)
    def m_angle(self) -> Floats:
        """Direction along which the larger one bends, likewise."""
        return principal(self.moment)[1]

    @property
    def standing(self) -> list[list[int]]:
        """Numbers of each stage and face where its shell stands."""
        places: list[list[int]] = np.argwhere(np.isfinite(self.normal[:, 0].T)).tolist()
        return places


def along(parts: Floats, angle: Floats) -> Floats:
    """The force across a section whose normal has an angle to axis 1 (n, ...).

    Args:
        parts: (n, 3, ...) components 11, 22 and 12.
        angle: (n, ...) towards axis 2, rad.
    """
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(c**2 * parts[:, 0] + s**2 * parts[:, 1] + 2.0 * c * s * parts[:, 2])


def principal(parts: Floats) -> tuple[Floats, Floats]:
    """Principal values (n, 2, ...), the larger first, and its angle to axis 1 (n, ...), rad.

    Args:
        parts: (n, 3, ...) components 11, 22 and 12.
    """
    middle, half = (parts[:, 0] + parts[:, 1]) / 2, (parts[:, 0] - parts[:, 1]) / 2
    radius = np.hypot(half, parts[:, 2])
    angle = 0.5 * np.arctan2(parts[:, 2], half)
    return np.stack([middle + radius, middle - radius], axis=1), np.asarray(angle)
