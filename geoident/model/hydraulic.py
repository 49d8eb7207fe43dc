"""Water in the pores of a material, and faces at which it leaves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from geoident.model.drains import VerticalDrains
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Scalar, Values, scalars_of

WATER_MODULUS = Scalar(2.2e9)
"""Bulk modulus of water without air, Pa."""

POROSITY = Scalar(0.4)
"""Of ground of which it is not given: what water stores hardly counts in soil."""


@dataclass(frozen=True)
class Hydraulic:
    """Ground that is full of water which takes time to leave; or which none ever enters.

    Args:
        permeability: m/s, one number for all directions or one for each axis; none for ground
            that is impervious.
        storage: of water in a volume of ground that keeps its shape, by pressure, 1/Pa; None:
            porosity by the modulus of the water.
        porosity: part of the volume that is water.
        water_modulus: bulk modulus of the water, Pa.
        biot: Biot's coefficient, 1 where grains do not change their volume.
        drains: vertical ones in it, at the pressure of the water at rest; None for none.
    """

    permeability: tuple[Scalar, ...] = ()
    storage: Scalar | None = None
    porosity: Scalar = POROSITY
    water_modulus: Scalar = WATER_MODULUS
    biot: Scalar = Scalar(1.0)
    drains: VerticalDrains | None = None

    @property
    def impervious(self) -> bool:
        """Whether no water enters it."""
        return not self.permeability

    @property
    def scalars(self) -> tuple[Scalar, ...]:
        """All its numbers."""
        drains = () if self.drains is None else self.drains.scalars
        return (*self.permeability, *scalars_of(self).values(), *drains)

    def stored(self, point: ParameterPoint) -> Dual:
        """Water stored by pressure, 1/Pa."""
        if self.storage is not None:
            return point.number(self.storage)
        return point.number(self.porosity) / point.number(self.water_modulus)

    def horizontal(self, dim: int, point: ParameterPoint) -> Dual:
        """Permeability along x, m/s; in space the geometric mean of those along x and y."""
        along = [point.number(number) for number in self.permeability]
        return (along[0] * along[1]).root() if dim == 3 and len(along) > 1 else along[0]

    def taken(self, dim: int, point: ParameterPoint) -> Dual | None:
        """What the drains take by head, volume and time, 1/(m s); None where there are none."""
        if self.drains is None:
            return None
        return self.drains.intake(self.horizontal(dim, point), point)

    def breach(self, values: Values) -> str | None:
        """The first number that cannot be at parameter values, a clause; None for none."""
        for what, number, most in self._bounded():
            value = number.value(values)
            if not 0.0 < value <= most:
                limit = "must be positive" if value <= 0.0 else f"must not exceed {most:g}"
                return f"{what} is {value:.4g}, it {limit}"
        wrong = None if self.drains is None else self.drains.breach(values)
        return None if wrong is None else wrong[1]

    def _bounded(self) -> Iterator[tuple[str, Scalar, float]]:
        """What each number is, it, and the most that it may be."""
        for number in self.permeability:
            yield "the permeability (m/s)", number, float("inf")
        if self.storage is not None:
            yield "the storage (1/Pa)", self.storage, float("inf")
        yield "the porosity", self.porosity, 1.0
        yield "the modulus of the water (Pa)", self.water_modulus, float("inf")
        yield "Biot's coefficient", self.biot, 1.0


@dataclass(frozen=True)
class Drained:
    """Faces at which water leaves freely.

    Args:
        head: of the water there, m above the origin; None: that at rest, with no excess pressure.
    """

    head: Scalar | None = None
