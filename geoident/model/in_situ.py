"""What a case says of the in-situ stress: models that are the same everywhere or grow with depth.

The vertical is the last coordinate axis (y in 2-D, z in 3-D). Stress is tension positive;
``held`` says whether the ground beyond the edges of the model holds the stress there, by tractions
that stay in all stages. None: yes for a stress that is the same everywhere (it can't be in
equilibrium otherwise), no for one that grows with depth.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from geoident.model.parameter import Scalar

Surface = Scalar | str
"""Where depth is counted from: a level (m), or a group of faces, lines in 2-D, with topography."""

Components = tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]
"""Numbers in the order xx, yy, zz, xy, yz, xz. In 2-D z is out of plane, yz and xz are zero."""

StressRatio = Scalar | Mapping[str, Scalar]
"""One number for all ground, or element group to its own."""


class _Stress(ABC):
    """What every in-situ stress knows of itself."""

    held: bool | None

    @property
    @abstractmethod
    def tensors(self) -> Mapping[str, Components]:
        """The stresses that it is made of as they are given, by their keys below its own."""

    @property
    def has_equal_ratios(self) -> bool:
        """Whether its ratios are the same in all horizontal directions."""
        return True

    @property
    def is_uniform(self) -> bool:
        """Whether it is the same everywhere: it does not grow with depth."""
        return False

    @property
    def is_held(self) -> bool:
        """Whether tractions on the edges of the model hold it (see the module)."""
        return self.is_uniform if self.held is None else self.held


@dataclass(frozen=True)
class ConstantStress(_Stress):
    """In-situ stress the same everywhere, tension positive, Pa."""

    surface: ClassVar[None] = None

    components: Components
    held: bool | None = None

    @property
    def tensors(self) -> Mapping[str, Components]:
        """The stress itself."""
        return {"": self.components}

    @property
    def is_uniform(self) -> bool:
        """Always."""
        return True


class _RatioStress(_Stress):
    """A vertical stress and horizontal ones in ratio to it, with a tectonic stress beside them."""

    K0: StressRatio | None
    K0_across: StressRatio | None
    tectonic: Components | None

    @property
    def tensors(self) -> Mapping[str, Components]:
        """The tectonic stress, if there is one."""
        return {} if self.tectonic is None else {"tectonic": self.tectonic}

    @property
    def has_equal_ratios(self) -> bool:
        """Whether one K0 holds along and across."""
        return self.K0_across in (None, self.K0)


@dataclass(frozen=True)
class HeimStress(_RatioStress):
    """Heim's in-situ stress: a vertical pressure and K0 times it on every horizontal plane.

    Either ``vertical`` (Pa, compression positive, the same everywhere) or ``unit_weight`` (N/m3)
    with the ``surface`` of the ground: sigma_v = -unit_weight * depth.

    Args:
        K0: ratio of horizontal to vertical stress: along x, or along the azimuth.
        K0_across: ratio in the other horizontal direction (out of plane in 2-D); None: K0.
        azimuth: 3-D: direction of K0, rad clockwise from y (north); None: along x.
        tectonic: stress added everywhere, Pa, tension positive; None for none.
        vertical: see above.
        unit_weight: see above.
        surface: see above.
        held: see the module.
    """

    K0: Scalar
    vertical: Scalar | None = None
    unit_weight: Scalar | None = None
    surface: Surface | None = None
    held: bool | None = None
    K0_across: Scalar | None = None
    azimuth: Scalar | None = None
    tectonic: Components | None = None

    @property
    def is_uniform(self) -> bool:
        """Whether a vertical stress is given, not the weight of the ground."""
        return self.vertical is not None


@dataclass(frozen=True)
class ProfileStress(_Stress):
    """A stress that changes linearly with depth: sigma = at_surface + gradient * depth.

    Depth is counted downwards from ``surface`` and is negative above it.

    Args:
        at_surface: stress at the surface, Pa.
        gradient: change per metre of depth, Pa/m.
        surface: where depth is counted from.
        held: see the module.
    """

    at_surface: Components
    gradient: Components
    surface: Surface
    held: bool | None = None

    @property
    def tensors(self) -> Mapping[str, Components]:
        """Stress at the surface and its change with depth."""
        return {"at_surface": self.at_surface, "gradient": self.gradient}


@dataclass(frozen=True)
class GeostaticStress(_RatioStress):
    """The weight of what lies above, layer by layer, and K0 times it on every vertical plane.

    The vertical stress follows from the densities of the materials, gravity, the water in the pores
    and what lies on the ground; nothing of it is stated twice. Ratios are those of effective
    stresses.

    Args:
        K0: ratio of horizontal to vertical stress: along x, or along the azimuth. Ground for which
            none is given is hardening soil, whose past gives it (theory 19).
        surface: of the ground; None: the top of the mesh.
        cover: unit weight of the ground between the top of the mesh and the surface, N/m3.
        surcharge: on the surface, Pa, compression positive; it stays in all stages.
        held: see the module.
        K0_across: ratio in the other horizontal direction (out of plane in 2-D); None: K0.
        azimuth: 3-D: direction of K0, rad clockwise from y (north); None: along x.
        tectonic: stress added everywhere, Pa, tension positive; None for none.
    """

    K0: StressRatio | None = None
    surface: Surface | None = None
    cover: Scalar | None = None
    surcharge: Scalar | None = None
    held: bool | None = None
    K0_across: StressRatio | None = None
    azimuth: Scalar | None = None
    tectonic: Components | None = None


InSitu = ConstantStress | HeimStress | ProfileStress | GeostaticStress
