"""How a material creeps and ages: keys ``creep``, ``ageing`` and ``softening`` of a material."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag

from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    CaseNumber,
    Coefficient,
    Modulus,
    Text,
    Time,
    Viscosity,
    scalar_of,
    shape_of,
)
from geoident.io.text.wording import Refusal
from geoident.model.case import KeyPath
from geoident.model.creep import (
    Ageing,
    ConcreteAgeing,
    CreepCurve,
    CreepElement,
    Dashpot,
    KelvinElement,
    StiffnessTable,
)
from geoident.model.in_service import TimeCurve
from geoident.model.parameter import Scalar
from geoident.units import UnitError, read_quantity

IN_TIME = ("creep", "ageing", "softening")
"""Keys of a material by which it changes with time."""

NORMAL_CEMENT = Scalar(0.25)

_EXPONENTS = {"eurocode-2": 0.3, "fib": 0.5}
"""Law of concrete to the exponent of its modulus."""


class TimeCurveSection(Section):
    """What grows with the time under load: `share` (1 - exp(-t / `time`)), or with the logarithm.

    It counts from `service.loaded` on.
    """

    builds = TimeCurve

    share: Coefficient = Field(
        description="The part of the modulus that is lost.", examples=["0.2", "$loss"]
    )
    time: Time = Field(description="In which it grows.", examples=["3 years", "$tau"])
    law: Literal["exponential", "logarithmic"] = Field(
        "exponential",
        description="`logarithmic`: `share` log(1 + t / `time`), which goes on.",
    )

    def check(self, faults: SectionFaults) -> None:
        """The share is not negative."""
        _refuse_negative(self.share, faults)


def _refuse_negative(share: CaseNumber | None, faults: SectionFaults) -> None:
    if share is not None and share.parameter is None and share.factor < 0.0:
        message = f"'{share.text}' is negative"
        hint = "A modulus that grows is 'ageing', one that falls 'softening'."
        faults.add(("share",), "out-of-range", message, hint)


class KelvinSection(Section):
    """A spring and a dashpot side by side: s = 2 G e + 2 viscosity e', or in volume with K."""

    one_of = (Alternatives("G", "K", hint="In shear its modulus is G, in volume alone K."),)

    G: Modulus | None = optional("Shear modulus of its spring.")
    K: Modulus | None = optional("Bulk modulus of its spring, `in: volume`.")
    viscosity: Viscosity = Field(
        description="Of its dashpot.", examples=["5e14 Pa s", "2 GPa d", "$eta_K"]
    )


class DashpotSection(Section):
    """A dashpot in a row with the elastic spring: s = 2 viscosity e' (Maxwell)."""

    viscosity: Viscosity = Field(description="Of the dashpot.", examples=["2e17 Pa s", "$eta_M"])


class CreepSection(Section):
    """An element of creep, or a Burgers chain: `kelvin` and `maxwell`.

    With `share` and `time` a Kelvin element in parts of the elastic strain. What creeps is the
    change of stress since the virgin state, under which ground was at rest, or since placing.
    """

    one_of = (
        Alternatives(
            "share time law?", "kelvin maxwell?", "maxwell", hint="More elements are a list."
        ),
    )

    share: Coefficient | None = optional(
        "The creep coefficient: that part of the elastic strain is added in the end.",
        examples=["0.8", "$phi"],
    )
    time: Time | None = optional("In which it comes.", examples=["30 d", "$tau"])
    law: Literal["exponential", "logarithmic"] | None = optional(
        "`exponential` if missing, `share` (1 - exp(-t / `time`)); `logarithmic`: "
        "`share` log(1 + t / `time`), which goes on."
    )
    kelvin: KelvinSection | None = optional(
        "A Kelvin element by its own constants.", examples=["{G: 200 MPa, viscosity: 5e14 Pa s}"]
    )
    maxwell: DashpotSection | None = optional(
        "The dashpot of a Maxwell element.", examples=["{viscosity: 2e17 Pa s}"]
    )
    part: Literal["shear", "volume", "both"] | None = optional(
        "Which part of the stress makes it creep. Missing: both for a `share`, shear "
        "for `kelvin` and `maxwell`. With `both` these are given by their shear, and take the same "
        "part of the elastic strain in volume.",
        alias="in",
    )

    def check(self, faults: SectionFaults) -> None:
        """The share is not negative, and a Kelvin element has the modulus of its part."""
        _refuse_negative(self.share, faults)
        if self.kelvin is None:
            return
        wanted, other = ("K", "G") if self.part == "volume" else ("G", "K")
        if getattr(self.kelvin, other) is not None:
            where = f"in: {self.part}" if self.part else "in shear, since 'in' is missing"
            message = f"found {other}; the element creeps {where}, which needs {wanted}"
            hint = f"Give {wanted}." if wanted == "K" else "Give G, or write 'in: volume'."
            faults.add(("kelvin", other), "wrong-pair", message, hint)

    def elements(self) -> tuple[CreepElement, ...]:
        """The elements for the model."""
        if self.share is not None:
            part = self.part or "both"
            return (self.to_model(CreepCurve, part=part),)
        part = self.part or "shear"
        elements: list[CreepElement] = []
        if self.kelvin is not None:
            modulus = scalar_of(self.kelvin.K if part == "volume" else self.kelvin.G)
            assert modulus is not None
            elements.append(KelvinElement(modulus, self.kelvin.viscosity.scalar, part))
        if self.maxwell is not None:
            elements.append(Dashpot(self.maxwell.viscosity.scalar, part))
        return tuple(elements)


CreepSections = Annotated[
    Annotated[CreepSection, Tag("<mapping>")]
    | Annotated[list[CreepSection], Field(min_length=1), Tag("list")],
    Discriminator(lambda value: "list" if shape_of(value) == "list" else "<mapping>"),
]


def sections_of_creep(
    given: list[CreepSection] | CreepSection | None,
) -> list[tuple[KeyPath, CreepSection]]:
    """The sections of the creep of a material, each with its path from the key on."""
    if given is None:
        return []
    return (
        [((n,), one) for n, one in enumerate(given)] if isinstance(given, list) else [((), given)]
    )


def build_creep(given: list[CreepSection] | CreepSection | None) -> tuple[CreepElement, ...]:
    """All elements of a material."""
    return tuple(element for _, one in sections_of_creep(given) for element in one.elements())


def _age(text: str) -> str:
    try:
        age = read_quantity(text, "time").value
    except UnitError as error:
        raise Refusal("bad-age", error.message, error.hint) from None
    if age < 0.0:
        raise Refusal("out-of-range", f"the age '{text}' is negative", "Give ages from 0 d on.")
    return text


Age = Annotated[Text, AfterValidator(_age)]


class AgeingSection(Section):
    """How the modulus grows with the age: of a stated table, of concrete, or by a share.

    The age counts from the stage that installs the ground, or changes it to the material; ground
    of the virgin state is old. In service it counts from `service.loaded` on.
    """

    one_of = (Alternatives("share time law?", "curve", "code s?", hint="Give one of these."),)

    curve: Annotated[dict[Age, Modulus], Field(min_length=2)] | None = optional(
        "Age to Young's modulus; linear in between, constant before the first and after the last.",
        examples=["{1 d: 12 GPa, 7 d: 25 GPa, 28 d: 30 GPa}"],
    )
    code: Literal["eurocode-2", "fib"] | None = optional(
        "Of concrete: `eurocode-2`, E exp(s (1 - sqrt(28 d / t)))^0.3, E being that at "
        "28 days; `fib`, ^0.5. An age below an hour counts as an hour."
    )
    s: Coefficient | None = optional(
        "Of the cement: 0.2 rapid, 0.25 normal (if missing), 0.38 slow.", examples=["0.2", "$s"]
    )
    share: Coefficient | None = optional(
        "The part of E by which the modulus grows.", examples=["0.2"]
    )
    time: Time | None = optional("In which it grows.", examples=["2 years"])
    law: Literal["exponential", "logarithmic"] | None = optional(
        "Of `share` and `time`: `exponential` if missing, or `logarithmic`, `share` "
        "log(1 + t / `time`)."
    )

    def check(self, faults: SectionFaults) -> None:
        """The share is not negative; no age of a table is given twice."""
        _refuse_negative(self.share, faults)
        ages = [read_quantity(text, "time").value for text in self.curve or ()]
        for n, text in enumerate(self.curve or ()):
            if ages[n] in ages[:n]:
                message = f"the age '{text}' is given twice"
                faults.add(("curve", text), "repeated-age", message, "Give each age once.")

    def for_model(self, context: Context) -> Ageing:
        """The law for the model."""
        if self.curve is not None:
            ages = {text: read_quantity(text, "time").value for text in self.curve}
            rows = sorted(self.curve, key=lambda text: ages[text])
            moduli = tuple(self.curve[text].scalar for text in rows)
            return StiffnessTable(tuple(ages[text] for text in rows), moduli)
        if self.share is not None:
            return self.to_model(TimeCurve)
        return ConcreteAgeing(scalar_of(self.s) or NORMAL_CEMENT, _EXPONENTS[self.code or ""])
