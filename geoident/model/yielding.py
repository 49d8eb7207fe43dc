"""Yield limits: as a case states them, which planes are reached, and what is proven of them.

Tension is positive; stresses and strengths in Pa.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, pi, tan
from typing import Any, ClassVar, Literal

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.bounds import Breach, Numbers, beyond, negative, not_positive
from geoident.model.dual import Dual
from geoident.model.empirical.rock_mass import LARGEST_GSI, strength_constants
from geoident.model.ground import Frame, Growth, angles_of
from geoident.model.parameter import Scalar, Values, scalars_of
from geoident.model.results.columns import Record, column, derived

Fit = Literal["inscribed", "circumscribed", "best"]
"""How a polyhedron lies to the exact surface: inside, around, or of the same size on average."""


@dataclass(frozen=True)
class YieldPlane:
    """One plane n^T sigma <= k.

    Args:
        name: in outputs.
        normal: (6,) unit normal in xx, yy, zz, xy, yz, xz (a shear stress counts once).
        distance: k, Pa; planes that name the same parameter are tied.
    """

    name: str
    normal: tuple[float, ...]
    distance: Scalar


@dataclass(frozen=True)
class _Surface(ABC):
    """What every yield surface knows of itself. Its own numbers are its strengths and angles."""

    kind: ClassVar[str]
    """Name by which users know it, in cases and in the names of planes."""

    tip: ClassVar[str] = "c / tan(phi)"
    """What its largest tension is without a cut-off."""

    dimensionless: ClassVar[tuple[str, ...]] = ()
    """Which of its numbers, beside angles, are no stresses."""

    @property
    def strengths(self) -> dict[str, Scalar]:
        """Its strengths and angles of strength, by name."""
        return scalars_of(self)

    @property
    def numbers(self) -> tuple[Scalar, ...]:
        """All numbers on which its planes depend."""
        return tuple(self.strengths.values())

    @property
    def in_principal_stresses(self) -> bool:
        """Whether its law is one of principal stresses, with exact edges and apex.

        Else planes in all components of the stress take its place.
        """
        return False

    @property
    @abstractmethod
    def description(self) -> str:
        """What it is, in a few words."""

    def breach(self, values: Values) -> Breach | None:
        """The first bound that its strengths break at parameter values (SI), or None."""
        return self._breach(self._values(values))

    def apex(self, values: Values) -> float | None:
        """The largest tension that the other strengths leave (`tip`), Pa.

        None where the surface has no friction.
        """
        numbers = self._values(values)
        phi = numbers.get("friction", 0.0)
        return numbers["cohesion"] / tan(phi) if 0.0 < phi < pi / 2 else None

    @abstractmethod
    def _breach(self, strengths: Numbers) -> Breach | None:
        """The first bound that its strengths (SI, by name) break, or None."""

    def _values(self, values: Values) -> dict[str, float]:
        return {name: number.value(values) for name, number in self.strengths.items()}


@dataclass(frozen=True)
class GivenPlanes(_Surface):
    """A polyhedron given plane by plane; ``hardening`` h: k grows by h lam of the same plane."""

    kind = "planes"

    planes: tuple[YieldPlane, ...]
    hardening: Scalar = Scalar(0.0)

    @property
    def numbers(self) -> tuple[Scalar, ...]:
        """Hardening, and the distances of the planes."""
        return (self.hardening, *(plane.distance for plane in self.planes))

    @property
    def description(self) -> str:
        """What it is, in a few words."""
        return "given planes"

    def _breach(self, strengths: Numbers) -> Breach | None:
        return negative(strengths, "hardening")


class _Coulomb(_Surface):
    """A surface by cohesion and angle of friction."""

    def _breach(self, strengths: Numbers) -> Breach | None:
        friction, cohesion = strengths["friction"], strengths["cohesion"]
        fault = _beyond_90_deg(strengths, "friction")
        if not fault and friction > 0.0:
            fault = negative(strengths, "cohesion")
        elif not fault and not cohesion > 0.0:
            fault = Breach("cohesion", cohesion, "without friction it must be positive")
        if not fault and not 0.0 <= strengths.get("dilation", 0.0) <= friction:
            limit = f"it must be from 0 to the friction angle, {degrees(friction):.6g} deg"
            fault = Breach("dilation", strengths["dilation"], limit)
        return fault or negative(strengths, "tension")


@dataclass(frozen=True)
class MohrCoulomb(_Coulomb):
    """Mohr-Coulomb; Tresca where friction is zero. Planes: None for the exact surface.

    Args:
        cohesion: c.
        friction: phi, rad.
        dilation: psi, rad; None: phi, associated. Only on the exact surface.
        tension: cut-off of the largest principal stress; None for none but the apex.
        planes: number of planes of the polyhedron in place of the exact surface, or None.
        fit: how the polyhedron lies.
    """

    kind = "mohr-coulomb"

    cohesion: Scalar
    friction: Scalar
    dilation: Scalar | None = None
    tension: Scalar | None = None
    planes: int | None = None
    fit: Fit = "best"

    @property
    def in_principal_stresses(self) -> bool:
        """Whether it is not replaced by planes."""
        return self.planes is None

    @property
    def description(self) -> str:
        """Its name, whether tension is cut off, and how its planes lie or how it flows."""
        name = "Tresca" if self.friction.factor == 0.0 else "Mohr-Coulomb"
        name = _with_tension(name, self.tension)
        if not self.in_principal_stresses:
            return f"{name} ({self.fit} fit)"
        flow = "with associated flow" if self.dilation is None else "with its own dilation"
        return f"{name}, exact, {flow}"


@dataclass(frozen=True)
class DruckerPrager(_Coulomb):
    """Drucker-Prager's cone, faceted, through Mohr-Coulomb's c and phi.

    Args:
        cohesion: c.
        friction: phi, rad.
        match: where the cone meets Mohr-Coulomb: at its outer (compression) or inner (tension)
            edges, or so that both carry the same in plane strain.
        tension: cut-off of the largest principal stress, or None.
        planes: number of planes.
        fit: how the polyhedron lies to the cone.
    """

    kind = "drucker-prager"

    cohesion: Scalar
    friction: Scalar
    match: Literal["outer", "inner", "plane-strain"] = "plane-strain"
    tension: Scalar | None = None
    planes: int = 24
    fit: Fit = "best"

    @property
    def description(self) -> str:
        """Its name, whether tension is cut off, and how its planes lie."""
        name = _with_tension("Drucker-Prager's cone", self.tension)
        return f"{name} ({self.fit} fit)"


@dataclass(frozen=True)
class WeakPlane(_Coulomb):
    """Coulomb on planes of one orientation (strata, joints): tau <= c - sigma_n tan(phi).

    Args:
        frame: its axis 3 is the normal of the planes.
        cohesion: c.
        friction: phi, rad.
        tension: largest normal stress, or None for c / tan(phi).
        planes: facets of the cone in a solid; in a section two suffice.
    """

    kind = "weak-plane"

    frame: Frame
    cohesion: Scalar
    friction: Scalar
    tension: Scalar | None = None
    planes: int = 16

    @property
    def numbers(self) -> tuple[Scalar, ...]:
        """Strengths, and the angles by which it lies."""
        return (*self.strengths.values(), *angles_of(self.frame).values())

    @property
    def description(self) -> str:
        """What it is, in a few words."""
        return "a weak plane"


@dataclass(frozen=True)
class HoekBrown(_Surface):
    """The generalised criterion of Hoek and Brown, by mi, GSI and D or by mb, s and a.

    Args:
        sigci: uniaxial compressive strength of intact rock.
        mi: constant of intact rock; with it GSI and D.
        GSI: Geological Strength Index, 0 to 100.
        D: disturbance, 0 to 1.
        mb: constant of the rock mass; with it s and a.
        s: constant of the rock mass, 1 for intact rock.
        a: exponent.
        dilation: psi, rad; None: associated.
        tension: cut-off of the largest principal stress; None for the tip, s sigci / mb.
    """

    kind = "hoek-brown"
    tip = "s sigci / mb"
    dimensionless = ("mi", "GSI", "D", "mb", "s", "a")

    sigci: Scalar
    mi: Scalar | None = None
    GSI: Scalar | None = None
    D: Scalar | None = None
    mb: Scalar | None = None
    s: Scalar | None = None
    a: Scalar | None = None
    dilation: Scalar | None = None
    tension: Scalar | None = None

    @property
    def in_principal_stresses(self) -> bool:
        """Always."""
        return True

    @property
    def description(self) -> str:
        """Its name, whether tension is cut off, and how it flows."""
        flow = "with associated flow" if self.dilation is None else "with its own dilation"
        return f"{_with_tension('generalised Hoek-Brown', self.tension)}, exact, {flow}"

    def rock_mass(self, number: Callable[[Scalar], Dual]) -> tuple[Dual, Dual, Dual]:
        """mb, s and a.

        Args:
            number: makes dual numbers of those of the case.
        """
        if self.mb is not None and self.s is not None and self.a is not None:
            return number(self.mb), number(self.s), number(self.a)
        assert self.mi is not None
        assert self.GSI is not None
        disturbed = Scalar(0.0) if self.D is None else self.D
        return strength_constants(number(self.mi), number(self.GSI), number(disturbed))

    def apex(self, values: Values) -> float | None:
        """The tensile strength that mb and s leave, Pa."""
        mb, s, _ = self.rock_mass(lambda scalar: Dual(scalar.columns(values, ())))
        return float(s.value) * self.sigci.value(values) / float(mb.value)

    def _breach(self, strengths: Numbers) -> Breach | None:
        return (
            not_positive(strengths, "sigci", "mi")
            or beyond(strengths, "GSI", 0.0, LARGEST_GSI)
            or beyond(strengths, "D", 0.0, 1.0)
            or not_positive(strengths, "mb")
            or beyond(strengths, "s", 0.0, 1.0)
            or beyond(strengths, "a", *_EXPONENTS)
            or _beyond_90_deg(strengths, "dilation")
            or negative(strengths, "tension")
        )


@dataclass(frozen=True)
class HardeningSoil(_Surface):
    """Hardening soil: stiffness by stress, hyperbolic shear, a cap (theory 19).

    It stands beside the yield surfaces of a material, not among them: its stress follows from a law
    with a state. The E of the material is that of unloading and reloading at p_ref.

    Args:
        m: exponent of the stress by which the stiffness grows.
        p_ref: reference stress.
        Rf: strength by the asymptote of the hyperbola.
        cohesion: c.
        friction: phi, rad.
        dilation: psi, rad.
        tension: tensile strength.
        E50: secant modulus at half of the strength in a drained triaxial test at p_ref; None:
            nothing hardens, Mohr-Coulomb alone.
        Eoed: tangent modulus of a first loading in the oedometer at p_ref; None: no cap.
        K0nc: stress to the sides by that upwards, in it; None: 1 - sin(phi).
        OCR: highest vertical stress of the past by that in situ; None: 1.
        POP: highest vertical stress of the past less that in situ; None: 0.
        preconsolidation_stress: in place of both, the highest vertical stress of the past. Without
            any of them the stress itself is the highest that there was.
        G0: shear modulus at the smallest strains, at p_ref; None: that of unloading.
        gamma_07: shear strain at which the secant shear modulus is 0.722 G0; with it.
    """

    kind = "hardening-soil"
    dimensionless = ("m", "Rf", "K0nc", "OCR", "gamma_07")

    m: Scalar
    p_ref: Scalar
    Rf: Scalar
    cohesion: Scalar
    friction: Scalar
    dilation: Scalar
    tension: Scalar
    E50: Scalar | None = None
    Eoed: Scalar | None = None
    K0nc: Scalar | None = None
    OCR: Scalar | None = None
    POP: Scalar | None = None
    preconsolidation_stress: Scalar | None = None
    G0: Scalar | None = None
    gamma_07: Scalar | None = None

    @property
    def in_principal_stresses(self) -> bool:
        """Always."""
        return True

    @property
    def description(self) -> str:
        """Its name, and whether it has a cap and small strains count."""
        name = "hardening soil" + (", without a cap" if self.Eoed is None else " with a cap")
        if self.E50 is None:
            name = "soil of Mohr-Coulomb, stiffer where it is pressed harder"
        return name if self.G0 is None else f"{name}, stiff at small strains"

    def _breach(self, strengths: Numbers) -> Breach | None:
        friction = strengths["friction"]
        if not 0.0 < friction < pi / 2:
            return Breach("friction", friction, "it must be above 0 and below 90 deg")
        if not 0.0 <= strengths["dilation"] <= friction:
            limit = f"it must be from 0 to the friction angle, {degrees(friction):.6g} deg"
            return Breach("dilation", strengths["dilation"], limit)
        apex, tension = strengths["cohesion"] / tan(friction), strengths["tension"]
        if not 0.0 <= tension <= apex:
            limit = f"it must be from 0 to cohesion / tan(friction), {apex:.6g} Pa"
            return Breach("tension", tension, limit)
        return (
            not_positive(strengths, "E50", "Eoed", "p_ref")
            or negative(strengths, "cohesion")
            or beyond(strengths, "m", 0.0, 1.0)
            or beyond(strengths, "Rf", 0.1, 0.99)
            or beyond(strengths, "K0nc", 0.05, 1.0)
            or (beyond(strengths, "OCR", 1.0, 1000.0))
            or negative(strengths, "POP")
            or not_positive(strengths, "preconsolidation_stress", "G0")
            or beyond(strengths, "gamma_07", 1e-6, 0.01)
        )


YieldSurface = GivenPlanes | MohrCoulomb | DruckerPrager | WeakPlane | HoekBrown | HardeningSoil


def with_strengths(
    surfaces: Sequence[YieldSurface], strengths: Mapping[tuple[int | None, str], Scalar]
) -> tuple[YieldSurface, ...]:
    """Surfaces with other numbers for some of their strengths, by index and name."""
    changed: list[dict[str, Any]] = [{} for _ in surfaces]
    for (number, name), scalar in strengths.items():
        if number is not None:
            changed[number][name] = scalar
    return tuple(replace(s, **own) for s, own in zip(surfaces, changed, strict=True))


def bounded_surfaces(
    surfaces: Sequence[YieldSurface], growths: Sequence[Growth]
) -> tuple[YieldSurface, ...]:
    """The surfaces to check against bounds.

    A strength that grows may start from zero, so an admissible one takes its place here; it is
    checked at the points of the ground.
    """
    admissible = {
        (growth.surface, growth.constant): Scalar(0.0 if growth.constant == "tension" else 1.0)
        for growth in growths
    }
    return with_strengths(surfaces, admissible)


_EXPONENTS = (0.2, 0.9)
"""Of Hoek-Brown: 0.5 to 0.67 by GSI; 0.25 and 0.75 are used for spalling (Diederichs 2007)."""


def _with_tension(name: str, tension: Scalar | None) -> str:
    return name if tension is None else f"{name} with a tension cut-off"


def _beyond_90_deg(strengths: Numbers, name: str) -> Breach | None:
    if 0.0 <= strengths.get(name, 0.0) < pi / 2:
        return None
    return Breach(name, strengths[name], "it must be from 0 to below 90 deg")


OF_STRUCTURE = "structure "
"""Beginning of the names of the planes of structures, whose k is a force and not a stress."""


class Activity(Record):
    """Which yield planes are reached where, at one parameter vector.

    Planes are those of all materials that yield, r in all; stages do not count the virgin state.

    Args:
        planes: r names such as ``rock: plane 3``.
        stages: names of the stages.
        points: (r, n_stages) strain points with a positive multiplier.
        biactive: (r, n_stages) strain points on the plane with no multiplier, to rounding.
        distances: (r,) k, Pa.
        reached: (r,) largest n^T sigma over all points and stages, Pa: if the plane was never
            reached, all that is known is k >= this. -inf where no point has the material.
        slopes: (r, n) dk/dp: on which parameters the distance depends.
    """

    planes: tuple[str, ...] = column("plane", name="plane")
    stages: tuple[str, ...] = column("stage", name="stage")
    points: Ints = column("plane", "stage")
    biactive: Ints = column("plane", "stage")
    distances: Floats = column("plane", name="distance", dimension="pressure")
    reached: Floats = column("plane", dimension="pressure")
    slopes: Floats = column(
        "plane", "parameter", name="slope", unit="Pa per SI unit of the parameter"
    )


class Certificate(Record):
    """What an identification of yield limits can say for itself.

    Args:
        kind: kind of stationary point: ``strongly stationary`` (no biactive point, gradient of the
            active pieces zero), ``stationary on the active pieces`` (biactive points: one-sided
            derivatives were checked), ``not stationary`` or ``global`` (a bound proves it).
        gradient: largest projected gradient of the discrepancy in scaled parameters, relative.
        activity: the planes at the estimate.
        lower_bounds: parameter to the value (SI) that it must exceed, for those whose planes no
            strain point reaches; they are not determined.
        bound: proven lower bound of the discrepancy, NaN if none was proven.
        gap: (objective - bound) relative to the objective, NaN if none.
        remarks: sentences for the report.
        open_above: parameters that may as well be so large that their planes are never reached;
            written as an interval that ends on the upper bound.
    """

    kind: str
    gradient: float
    activity: Activity = column()
    lower_bounds: dict[str, float] = field(default_factory=dict)
    bound: float = float("nan")
    gap: float = float("nan")
    remarks: tuple[str, ...] = column("remark", default=(), name="remark")
    open_above: tuple[str, ...] = ()

    @classmethod
    def from_columns(
        cls, *, bounded: tuple[str, ...], at_least: Floats, **columns: Any
    ) -> Certificate:
        """The certificate from its columns.

        Args:
            bounded: names of the parameters with lower bounds.
            at_least: these, SI.
            **columns: all others.
        """
        return cls(**columns, lower_bounds=dict(zip(bounded, at_least.tolist(), strict=True)))

    @property
    @derived("bounded", stored=True)
    def bounded(self) -> tuple[str, ...]:
        """Names of the parameters with `lower_bounds`."""
        return tuple(self.lower_bounds)

    @property
    @derived("bounded", unit="SI unit of the parameter", stored=True)
    def at_least(self) -> Floats:
        """These bounds, SI."""
        return np.array([*self.lower_bounds.values()], dtype=np.float64)
