"""The parameters of a case: what is identified, and what is known of it before."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from pydantic import Field

from geoident.io.schema.section import Section, SectionFaults, optional
from geoident.io.schema.values import AnyQuantity, Bounds, CaseNumber, Text
from geoident.model.case import KeyPath
from geoident.model.parameter import Parameter, Prior
from geoident.units import DIMENSIONLESS, DIMENSIONS, UNITS, with_article


class PriorSection(Section):
    """What is known of a parameter before any reading."""

    mean: AnyQuantity = Field(description="Mean (normal) or median (lognormal).")
    sd: AnyQuantity = Field(description="Standard deviation, in the dimension of the mean.")
    kind: Literal["normal", "lognormal"] = Field("normal", description="Its distribution.")


class ParameterSection(Section):
    """One unknown. Its dimension is that of its start."""

    start: AnyQuantity = Field(
        description="Value to start from; its unit is that of tables.", examples=["15 GPa", 1.0]
    )
    bounds: Bounds = Field(examples=[["2 GPa", "80 GPa"]])
    scale: Literal["linear", "log"] = Field(
        "linear", description="log works on the logarithm, as is right for moduli."
    )
    prior: PriorSection | None = optional(
        "Prior knowledge; without it all values within the bounds are equally likely."
    )
    describe: Text | None = optional(
        "What it is, in words for readers of results and reports.", examples=["modulus of the clay"]
    )

    def check(self, faults: SectionFaults) -> None:
        """Start, bounds and prior agree."""
        self._check_dimensions(faults)
        if not faults.found:
            self._check_bounds(faults)
            self._check_prior(faults)

    def parameter(self, name: str) -> Parameter:
        """The parameter of this name, in SI units."""
        lower, upper = self.bounds
        return self.to_model(
            Parameter,
            prior=self.prior and self.prior.to_model(Prior),
            name=name,
            lower=lower.factor,
            upper=upper.factor,
            dimension=self.start.dimension,
            unit=self.start.unit,
        )

    def _numbers(self) -> list[tuple[KeyPath, CaseNumber]]:
        numbers: list[tuple[KeyPath, CaseNumber]] = [
            (("bounds", n), b) for n, b in enumerate(self.bounds)
        ]
        if self.prior:
            numbers += [(("prior", "mean"), self.prior.mean), (("prior", "sd"), self.prior.sd)]
        return numbers

    def _likely_unit(self) -> str:
        """The unit of the bounds, if the start lies between them in it; else the SI unit."""
        low, high = self.bounds
        _, size = UNITS.get(low.unit, ("", 1.0))
        between = low.factor <= self.start.factor * size <= high.factor
        return low.unit if between and low.unit else DIMENSIONS[low.dimension]

    def _check_dimensions(self, faults: SectionFaults) -> None:
        start, wanted = self.start, {bound.dimension for bound in self.bounds}
        if start.unit == "" and wanted.isdisjoint({DIMENSIONLESS}):
            message = f"the start '{start.text}' has no unit, but its bounds have"
            unit = self._likely_unit()
            faults.add(("start",), "unit", message, f"Write '{start.text} {unit}' or another unit.")
            return
        for path, given in self._numbers():
            if given.dimension != start.dimension:
                message = f"'{given.text}' is {with_article(given.dimension)}, but start "
                message += f"'{start.text}' is {with_article(start.dimension)}"
                faults.add(path, "unit", message, "Write both in units of one dimension.")

    def _check_bounds(self, faults: SectionFaults) -> None:
        lower, upper = self.bounds
        if not lower.factor <= self.start.factor <= upper.factor:
            message = f"the start '{self.start.text}' is outside the bounds "
            message += f"[{lower.text}, {upper.text}]"
            faults.add(("start",), "start-outside", message, "Widen the bounds or move the start.")
        if self.scale == "log" and min(lower.factor, upper.factor) <= 0:
            message = f"scale log needs positive bounds; found [{lower.text}, {upper.text}]"
            faults.add(("bounds",), "bad-bounds", message, "Raise the bound or use scale: linear.")

    def _check_prior(self, faults: SectionFaults) -> None:
        prior = self.prior
        if prior is None:
            return
        if prior.sd.factor <= 0:
            message = f"the standard deviation '{prior.sd.text}' is not positive"
            faults.add(("prior", "sd"), "bad-prior", message, "Write one above zero.")
        if prior.kind != "lognormal":
            return
        if prior.mean.factor <= 0:
            message = f"a lognormal prior needs a positive mean; found '{prior.mean.text}'"
            faults.add(("prior", "mean"), "bad-prior", message, "Use kind: normal.")
        if self.bounds[0].factor <= 0:
            message = f"a lognormal prior needs positive bounds; found '{self.bounds[0].text}'"
            faults.add(("bounds", 0), "bad-prior", message, "Raise the bound or use kind: normal.")


def numbers_at_start(
    numbers: Iterable[CaseNumber], parameters: Mapping[str, ParameterSection]
) -> dict[str, float] | None:
    """The parameters at their starts, by name, SI.

    Args:
        numbers: what is to be evaluated there.
        parameters: name to section.

    Returns:
        None if one of the numbers is tied to no parameter, or to one of another dimension.
    """
    starts = {name: section.start for name, section in parameters.items()}
    for tie in numbers:
        if tie.parameter is None:
            continue
        if tie.parameter not in starts or starts[tie.parameter].dimension != tie.dimension:
            return None
    return {name: start.factor for name, start in starts.items()}
