"""Structural parts of a case: linings and walls as beams or shells; bolts and the like as bars.

Those of a round opening in closed form press on its wall all round.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from geoident.model.creep import Ageing, named_numbers
from geoident.model.parameter import Scalar, Values, scalars_of

_MAY_BE_ZERO = ("prestress", "density", "weight", "yield.tensile_strength", "ageing.share")

SecondEnd = Literal["joined", "fixed", "symmetry"]
"""What holds the second end of a bar: the mesh, a place that does not move, or its mirror image."""


@dataclass(frozen=True)
class _Structure:
    """What every structure knows of itself."""

    @property
    def numbers(self) -> dict[str, Scalar]:
        """The numbers that the case gives of it, by name."""
        return scalars_of(self)

    @property
    def yields(self) -> bool:
        """Whether it has yield limits, in an analysis on a mesh."""
        return False

    def breach(self, values: Values) -> str | None:
        """Which of its numbers is impossible at parameter values (SI), half a sentence, or None."""
        for name, scalar in self.numbers.items():
            number = scalar.value(values)
            if name == "nu":
                if not -1.0 < number < 0.5:
                    return f"nu is {number:.6g}, it must be between -1 and 0.5"
            elif name in _MAY_BE_ZERO:
                if not number >= 0.0:
                    return f"{name} is {number:.6g}, it must not be negative"
            elif not number > 0.0:
                return f"{name} is {number:.6g}, it must be positive"
        return None


Interaction = Literal["section", "linear", "none"]
"""How N and M use up the strength of a section together."""


@dataclass(frozen=True)
class SectionLimits:
    """What a section of a beam bears before it yields, per metre.

    Either limits of N and M, or the strengths of a rectangular section, with the thickness of the
    beam.

    Args:
        N: limit of the axial force, pull and push alike, N/m; None: no limit.
        M: limit of the bending moment, N m/m; None: no limit.
        interaction: of N and M where both are limited: that of a rectangular section alike in
            tension and compression, |M| / M_p + (N / N_p)^2 <= 1; linear, |M| / M_p + |N| / N_p
            <= 1; or none, each by itself.
        compressive_strength: of the rectangular section, Pa.
        tensile_strength: likewise, Pa.
    """

    N: Scalar | None = None
    M: Scalar | None = None
    interaction: Interaction = "section"
    compressive_strength: Scalar | None = None
    tensile_strength: Scalar = Scalar(0.0)


@dataclass(frozen=True)
class Beam(_Structure):
    """A lining or wall: a beam per metre out of plane; about an axis a shell of revolution.

    Either E and thickness, or EA and EI.

    Args:
        group: group of lines of the mesh on which it is built.
        E: Young's modulus, Pa.
        thickness: m.
        nu: Poisson's ratio: then E / (1 - nu^2) is taken, as for a wall long out of plane. Of a
            shell a given number, since it couples meridian and hoops.
        EA: axial stiffness, N/m.
        EI: bending stiffness, N m (N m2 per metre).
        clamped_on: groups on whose nodes the beam does not turn (planes of symmetry, abutments).
        hinges: where its pieces turn against each other: points (dim,), m, or groups of the mesh.
        density: kg/m3, with the thickness.
        weight: of a square metre of it, Pa, where no thickness is given.
        compressive_strength: of its section, Pa; None: how far it is used is not asked for.
        tensile_strength: likewise.
        limits: what its section bears before it yields; None: it is elastic.
        ageing: how its stiffness grows since it was built; None: it does not.
    """

    group: str
    E: Scalar | None = None
    thickness: Scalar | None = None
    nu: Scalar | None = None
    EA: Scalar | None = None
    EI: Scalar | None = None
    clamped_on: tuple[str, ...] = ()
    hinges: tuple[str | tuple[float, ...], ...] = ()
    density: Scalar | None = None
    weight: Scalar | None = None
    compressive_strength: float | None = None
    tensile_strength: float = 0.0
    limits: SectionLimits | None = None
    ageing: Ageing | None = None

    @property
    def numbers(self) -> dict[str, Scalar]:
        """Those of its yield limits and its ageing among them."""
        limits = {} if self.limits is None else scalars_of(self.limits)
        grown = {} if self.ageing is None else named_numbers(self.ageing)
        return (
            scalars_of(self)
            | {f"yield.{name}": scalar for name, scalar in limits.items()}
            | {f"ageing.{name}": scalar for name, scalar in grown.items()}
        )

    @property
    def yields(self) -> bool:
        """Whether its section has limits."""
        return self.limits is not None

    @property
    def has_weight(self) -> bool:
        """Whether anything is said of its weight."""
        return self.density is not None or self.weight is not None


@dataclass(frozen=True)
class Shell(_Structure):
    """A lining, slab or wall on faces of a solid: it bears in its plane, and bends.

    Args:
        group: group of faces of the mesh on which it is built.
        E: Young's modulus, Pa.
        thickness: m.
        nu: Poisson's ratio.
        axis: (3,) direction of axis 1 of its forces, projected on its faces.
        clamped_on: groups on whose nodes it does not turn (abutments).
        mirrored_on: groups on planes of symmetry: it only turns about their normals there.
        density: kg/m3.
        weight: of a square metre of it, Pa, in place of the density.
        compressive_strength: of its section, Pa; None: how far it is used is not asked for.
        tensile_strength: likewise.
        ageing: how its stiffness grows since it was built; None: it does not.
    """

    group: str
    E: Scalar
    thickness: Scalar
    nu: Scalar
    axis: tuple[float, ...]
    clamped_on: tuple[str, ...] = ()
    mirrored_on: tuple[str, ...] = ()
    density: Scalar | None = None
    weight: Scalar | None = None
    compressive_strength: float | None = None
    tensile_strength: float = 0.0
    ageing: Ageing | None = None

    @property
    def numbers(self) -> dict[str, Scalar]:
        """Those of its ageing among them."""
        grown = {} if self.ageing is None else named_numbers(self.ageing)
        return scalars_of(self) | {f"ageing.{name}": scalar for name, scalar in grown.items()}

    @property
    def has_weight(self) -> bool:
        """Whether anything is said of its weight."""
        return self.density is not None or self.weight is not None


@dataclass(frozen=True)
class Bars(_Structure):
    """Straight bars that bear axial forces only. Either E and diameter (or area), or EA.

    Args:
        ends: the two end points of every bar, m.
        spacing: distance to the next one: out of plane in plane strain; along the circumference
            through the first end about an axis; None in a solid. m.
        E: Young's modulus, Pa.
        diameter: m.
        EA: axial stiffness of one bar, N.
        area: of the section of one bar, m2.
        number: of bars around the axis, in place of the spacing.
        prestress: force of one bar at building, N: a pull, of struts a push.
        capacity: force of one bar, pull or push, at which it yields, N; None: it is elastic.
    """

    ends: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]
    spacing: Scalar | None = None
    E: Scalar | None = None
    diameter: Scalar | None = None
    EA: Scalar | None = None
    area: Scalar | None = None
    number: Scalar | None = None
    prestress: Scalar | None = None
    capacity: Scalar | None = None

    sense: ClassVar[float] = 1.0
    """Axial force (tension positive) per prestress."""

    second_end: SecondEnd = field(default="joined", kw_only=True)

    @property
    def yields(self) -> bool:
        """Whether its bars have a capacity."""
        return self.capacity is not None

    @property
    def bends(self) -> bool:
        """Whether its bars bear moments."""
        return False

    def breach(self, values: Values) -> str | None:
        """Bars are not stressed beyond what they bear, either."""
        reason = super().breach(values)
        if reason is None and self.prestress is not None:
            reason = self.overstressed(self.prestress, values)
        return reason

    def overstressed(self, force: Scalar, values: Values) -> str | None:
        """Which force of the jack is beyond the capacity, half a sentence, or None."""
        if self.capacity is None:
            return None
        prestress, capacity = force.value(values), self.capacity.value(values)
        if prestress <= capacity:
            return None
        return f"the prestress is {prestress:.6g}, beyond the capacity {capacity:.6g}"


@dataclass(frozen=True)
class Bolts(Bars):
    """Bars that hold the ground at their two ends only; they are stressed by a pull."""


@dataclass(frozen=True)
class Struts(Bars):
    """Bars that prop what stands at their first end against the second; they are jacked apart.

    ``second_end`` says what holds them there: ``joined``, the mesh; ``fixed``, a place that does
    not move; ``symmetry``, its other half: the strut ends at half its length on a plane of symmetry
    of the model, where it does not move along itself.

    Args:
        compression_only: they are wedged in, and a pull opens a gap, which closes before they press
            again; else they pull, too.
    """

    sense = -1.0

    compression_only: bool = field(default=False, kw_only=True)

    @property
    def yields(self) -> bool:
        """Whether they have a capacity, or bear no pull."""
        return super().yields or self.compression_only


@dataclass(frozen=True)
class Anchors(Bars):
    """Bars from a head to a toe, held by the ground along the grouted length at the toe.

    Between head and grout they touch nothing. They are stressed by a pull at the head.

    Args:
        grouted: length of the part at the toe that is held by the ground, m.
    """

    grouted: float = field(default=0.0, kw_only=True)


@dataclass(frozen=True)
class GroutedBars(Bars):
    """Rock bolts that grout ties to the ground all along, and that slip in it.

    Args:
        k_grout: force per length of one bar, and per slip of it against the ground, Pa.
        bond: force per length of one bar at which it slips, N/m; None: it never does.
        free: length at the head that touches nothing, m.
        head: joined, it moves with the ground where it lies, as by a plate; free; of piles that
            bend also clamped: joined, and it does not turn.
        pieces: of its grouted length, each of one slip and one axial force in its middle.
    """

    k_grout: Scalar = field(kw_only=True)
    bond: Scalar | None = field(default=None, kw_only=True)
    free: float = field(default=0.0, kw_only=True)
    head: Literal["joined", "free", "clamped"] = field(default="joined", kw_only=True)
    pieces: int = field(default=40, kw_only=True)

    @property
    def yields(self) -> bool:
        """Whether its bars have a capacity, or its grout a bond."""
        return self.capacity is not None or self.bond is not None


@dataclass(frozen=True)
class Piles(GroutedBars):
    """Piles: the ground holds them along the shaft, at the toe and, where they bend, across it.

    Args:
        k_base: force at the toe of one pile per motion of it into the ground, N/m; None: none.
        base_capacity: force at which it sinks in, N; None: no limit. The toe is never pulled.
        k_lateral: force across a pile, per length and motion against the ground, Pa; None: nothing
            holds it across itself, and it does not bend.
        lateral_resistance: force per length at which the ground yields beside it, N/m; None: never.
        EI: bending stiffness of one pile, N m2; None: that of a full round section.
    """

    k_base: Scalar | None = field(default=None, kw_only=True)
    base_capacity: Scalar | None = field(default=None, kw_only=True)
    k_lateral: Scalar | None = field(default=None, kw_only=True)
    lateral_resistance: Scalar | None = field(default=None, kw_only=True)
    EI: Scalar | None = field(default=None, kw_only=True)

    @property
    def bends(self) -> bool:
        """Whether the ground holds them across themselves."""
        return self.k_lateral is not None

    @property
    def numbers(self) -> dict[str, Scalar]:
        """Those of the shaft by their names in the case."""
        names = {"k_grout": "k_shaft", "bond": "skin_friction"}
        return {names.get(name, name): scalar for name, scalar in super().numbers.items()}

    @property
    def yields(self) -> bool:
        """Whether shaft, pile or the ground beside it do; a toe always does, since it lifts off."""
        return super().yields or self.k_base is not None or self.lateral_resistance is not None


@dataclass(frozen=True)
class PileContacts(Bars):
    """What holds piles across themselves: springs.

    Args:
        stiffness: of one pile, by its length, Pa; of a toe N/m.
        strength: by its length, N/m; of a toe N; None: no limit.
    """

    stiffness: Scalar = field(kw_only=True)
    strength: Scalar | None = field(default=None, kw_only=True)

    @property
    def yields(self) -> bool:
        """Whether they have a strength."""
        return self.strength is not None


@dataclass(frozen=True)
class PileToes(PileContacts):
    """What holds the toes of piles: springs that press and do not pull."""

    @property
    def yields(self) -> bool:
        """They lift off."""
        return True


@dataclass(frozen=True)
class PileBending(Bars):
    """The bending of piles.

    Args:
        EI: of one pile, N m2; None: that of a full round section by E and diameter.
    """

    EI: Scalar | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class Ring(_Structure):
    """A closed ring of shotcrete or concrete around an opening in closed form.

    Args:
        E: Young's modulus, Pa; where it hardens that of old concrete.
        thickness: m.
        nu: Poisson's ratio.
        strength: uniaxial compressive strength, Pa; None: it carries all.
        hardening_time: T, s: E and strength have grown to 1 - exp(-t / T) at the age t; None: they
            are the same from the beginning.
        hardening_distance: the same by the way of the face since it was built, m.
    """

    E: Scalar
    thickness: Scalar
    nu: Scalar = Scalar(0.2)
    strength: Scalar | None = None
    hardening_time: Scalar | None = None
    hardening_distance: Scalar | None = None


@dataclass(frozen=True)
class Ribs(_Structure):
    """Closed steel sets that bear on the wall all round.

    Args:
        E: Young's modulus, Pa.
        area: of the section of one, m2.
        spacing: along the opening, m.
        strength: yield strength, Pa; None: they carry all.
    """

    E: Scalar
    area: Scalar
    spacing: Scalar
    strength: Scalar | None = None


@dataclass(frozen=True)
class BoltPattern(_Structure):
    """Bolts that are held at their head and their end, all around an opening.

    Args:
        E: Young's modulus, Pa.
        diameter: m.
        length: m.
        spacing: around the wall, m.
        rows: distance of the rows along the opening, m; None: as the spacing.
        capacity: force that head, bar and end carry, N; None: all.
        head_stiffness: force per displacement of head and end, N/m; None: rigid.
    """

    E: Scalar
    diameter: Scalar
    length: Scalar
    spacing: Scalar
    rows: Scalar | None = None
    capacity: Scalar | None = None
    head_stiffness: Scalar | None = None


@dataclass(frozen=True)
class SupportLine(_Structure):
    """A support of which only its line is known.

    Args:
        stiffness: pressure on the wall per motion of the wall inwards, Pa/m.
        capacity: largest pressure, Pa; None: no limit.
    """

    stiffness: Scalar
    capacity: Scalar | None = None


OpeningSupport = Ring | Ribs | BoltPattern | SupportLine
"""What supports an opening in closed form."""

Structure = Beam | Shell | Bars | OpeningSupport


def ages(structure: Structure) -> bool:
    """Whether its stiffness grows since it was built, in an analysis on a mesh."""
    return isinstance(structure, Beam | Shell) and structure.ageing is not None
