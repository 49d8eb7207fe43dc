"""How a material creeps under stress, and its stiffness by age (theory 18.4, 18.5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from geoident.model.in_service import TimeCurve
from geoident.model.parameter import Scalar, Values, scalars_of

Part = Literal["shear", "volume", "both"]
"""Which part of the stress makes an element creep: its deviator, its mean, or all of it."""


@dataclass(frozen=True)
class CreepCurve(TimeCurve):
    """A share of the elastic strain that comes with time: a Kelvin element, or with the logarithm.

    Args:
        part: of the stress that makes it creep.
    """

    part: Part = "both"

    @property
    def positive(self) -> dict[str, Scalar]:
        """Those that must be positive, by name; the share may be zero."""
        return {"time": self.time}


@dataclass(frozen=True)
class KelvinElement:
    """A spring and a dashpot side by side: s = 2 G e + 2 eta e', or p = K v + eta v'.

    In both shear and volume it is given by its shear, and takes the same share of the elastic
    strain in the same time in volume.

    Args:
        modulus: G, Pa; K where it creeps in volume alone.
        viscosity: eta, Pa s.
        part: of the stress that makes it creep.
    """

    modulus: Scalar
    viscosity: Scalar
    part: Part = "shear"

    @property
    def positive(self) -> dict[str, Scalar]:
        """Those that must be positive, by name."""
        return {"G" if self.part != "volume" else "K": self.modulus, "viscosity": self.viscosity}


@dataclass(frozen=True)
class Dashpot:
    """A dashpot in a row with the elastic spring (Maxwell): s = 2 eta e', or p = eta v'.

    Args:
        viscosity: eta, Pa s.
        part: of the stress that makes it creep.
    """

    viscosity: Scalar
    part: Part = "shear"

    @property
    def positive(self) -> dict[str, Scalar]:
        """Those that must be positive, by name."""
        return {"viscosity": self.viscosity}


CreepElement = CreepCurve | KelvinElement | Dashpot


def ends(element: CreepElement) -> bool:
    """Whether its strain under a stress that stays comes to an end."""
    if isinstance(element, CreepCurve):
        return element.law == "exponential"
    return isinstance(element, KelvinElement)


def impossible_ageing(ageing: Ageing, values: Values) -> str | None:
    """Which number of a law is impossible at parameter values (SI), a clause, or None."""
    for name, scalar in named_numbers(ageing).items():
        number = scalar.value(values)
        if number < 0.0 or (name != "share" and number == 0.0):
            return f"the {name} of its ageing is {number:.6g}, it must be positive"
    return None


def impossible(element: CreepElement, values: Values) -> str | None:
    """Which number of an element is impossible at parameter values (SI), a clause, or None."""
    for name, scalar in element.positive.items():
        if not scalar.value(values) > 0.0:
            return f"the {name} of its creep is {scalar.value(values):.6g}, it must be positive"
    if isinstance(element, CreepCurve) and not element.share.value(values) >= 0.0:
        share = element.share.value(values)
        return f"the share of its creep is {share:.6g}, it must not be negative"
    return None


@dataclass(frozen=True)
class StiffnessTable:
    """The modulus at some ages, linear in between, constant before and after.

    Args:
        ages: s, increasing.
        moduli: Pa. The E of the material is that by which shares of creep are counted.
    """

    ages: tuple[float, ...]
    moduli: tuple[Scalar, ...]

    @property
    def numbers(self) -> tuple[Scalar, ...]:
        """All its numbers."""
        return self.moduli


@dataclass(frozen=True)
class ConcreteAgeing:
    """E(t) = E beta^exponent with beta = exp(s (1 - sqrt(28 d / t))), where E is that at 28 days.

    Eurocode 2 (EN 1992-1-1:2004), 3.1.3, has the exponent 0.3; fib Model Code 2010, 5.1.9, 0.5.

    Args:
        s: of the cement: 0.2 rapid, 0.25 normal, 0.38 slow.
        exponent: of beta.
    """

    s: Scalar
    exponent: float = 0.3

    @property
    def numbers(self) -> tuple[Scalar, ...]:
        """All its numbers."""
        return (self.s,)


Ageing = TimeCurve | StiffnessTable | ConcreteAgeing
"""How the modulus grows: by a share of it (`TimeCurve`), by a table, or as that of concrete."""


def named_numbers(ageing: Ageing) -> dict[str, Scalar]:
    """All numbers of a law of ageing, by name."""
    if isinstance(ageing, StiffnessTable):
        return {f"modulus {n}": modulus for n, modulus in enumerate(ageing.moduli, start=1)}
    return scalars_of(ageing)
