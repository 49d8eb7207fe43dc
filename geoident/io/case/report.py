"""What a case says of its report; it is read alone, too, since it may be written after the fit."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, Field, ValidationError

from geoident.io.schema.faults import add_schema_faults
from geoident.io.schema.section import Section
from geoident.io.schema.values import Text
from geoident.io.text.faults import Faults
from geoident.io.text.overrides import apply_overrides
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.results.head import ReportHead


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
