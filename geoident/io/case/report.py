"""What a case says of its report; it is read alone, too, since it may be written after the fit."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, Field, ValidationError

from geoident.io.schema.faults import add_schema_faults
from geoident.io.schema.section import Section, SectionFaults, optional
from geoident.io.schema.values import AnyQuantity, Flag, Name, Text
from geoident.io.text.faults import Faults
from geoident.io.text.overrides import apply_overrides
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.results.head import ReportHead


class CurvesSection(Section):
    """A figure of gauges over a number of each stage, such as the load of a load test.

    Of `tests` the case has such figures without this key: each column over that which is imposed.
    """

    read: Name = Field(
        description="What the gauges read, for the axis.", examples=["settlement of the head"]
    )
    over: Name = Field(description="What the numbers are, for the axis.", examples=["load"])
    gauges: Annotated[dict[Name, Name], Field(min_length=1)] = Field(
        description="Gauges, or their channels, by what they are called in the figure. They are "
        "left out of the figures over stages.",
        examples=[{"pile 3": "HEAD 3"}],
    )
    stages: Annotated[dict[Name, AnyQuantity], Field(min_length=1)] = Field(
        description="Stage to its number; gauges are not drawn at others.",
        examples=[{"step 1": "500 kN", "step 2": "1 MN"}],
    )
    scale: Literal["linear", "log"] = Field("linear", description="Of the numbers.")
    downwards: Flag = Field(False, description="Draw what is read downwards, as settlement.")

    def check(self, faults: SectionFaults) -> None:
        """Numbers of one dimension, above zero on a logarithm."""
        first = next(iter(self.stages.values()))
        for stage, number in self.stages.items():
            if number.dimension != first.dimension:
                message = f"'{number.text}' is no {first.dimension}, as '{first.text}' is"
                faults.add(("stages", stage), "wrong-dimension", message, "Correct its unit.")
            elif self.scale == "log" and not number.factor > 0.0:
                message = f"'{number.text}' has no logarithm"
                faults.add(("stages", stage), "out-of-range", message, "Write 'scale: linear'.")


class ReportSection(Section):
    """What the report says of itself; nothing is computed from it, so a change asks for no new fit.

    Flags of `report`, such as `--client`, override it.
    """

    project: Text = Field("", description="The project.", examples=["Power station Upper Valley"])
    author: Text = Field("", description="Who made the report.", examples=["J. Doe, Ground AG"])
    client: Text = Field("", description="For whom it was made.")
    revision: Text = Field("", description="Its revision.", examples=["B"])
    date: Text = Field("", description="Its date, as printed.", examples=["3 May 2026"])
    logo: Text = Field(
        "",
        description="Path of a picture, .png or .svg, relative to the case.",
        examples=["logo.svg"],
    )
    curves: list[CurvesSection] | None = optional(
        "Figures of gauges over a number of each stage; those of a fit are kept."
    )


def check_curves(
    report: ReportSection, gauges: Collection[str], stages: Collection[str], faults: Faults
) -> None:
    """Gauges and stages of figures that the case does not have.

    Args:
        report: of the case.
        gauges: of the case, and their channels.
        stages: of the case.
        faults: takes them.
    """
    for n, one in enumerate(report.curves or ()):
        for label, name in one.gauges.items():
            if name not in gauges:
                faults.add_unknown(("report", "curves", n, "gauges", label), "gauge", name, gauges)
        for name in one.stages:
            if name not in stages:
                path = ("report", "curves", n, "stages", name)
                faults.add_unknown(path, "stage", name, stages, key=True)


class _OnlyReport(BaseModel):
    """The one section of a case of which a report speaks."""

    report: ReportSection | None = None


def read_report_head(text: str, path: str) -> ReportHead:
    """What a case says of its report, whatever else is right or wrong in it.

    Args:
        text: the case.
        path: where it stands or stood; its logo is looked for beside it.

    Raises:
        InputError: the text is no YAML, or its section ``report`` is wrong.
    """
    places = apply_overrides(parse_yaml(text, path), ())
    if not isinstance(places.data, dict):
        return ReportHead()
    faults, sections = Faults(places), dict[int, type[Section]]()
    try:
        head = _OnlyReport.model_validate(places.data, context=sections).report
    except ValidationError as error:
        add_schema_faults(faults, error.errors(include_url=False), places.data, sections)
        faults.raise_any()
        raise
    if head is None:
        return ReportHead()
    logo = str(Path(path).parent / head.logo) if head.logo else ""
    return head.to_model(ReportHead, logo=logo)
