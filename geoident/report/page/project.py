"""The report of several sections: laws, sections, what is predicted, what was left out in turn."""

from __future__ import annotations

from geoident.model.results.head import NO_HEAD, ReportHead
from geoident.model.results.many.project import ProjectResult, SectionEnd
from geoident.report.drawing.project.laws import estimate_pictures, law_pictures
from geoident.report.drawing.project.readings import reading_pictures
from geoident.report.drawing.style import svg_files
from geoident.report.page.blocks import (
    Draw,
    Figures,
    TitledTable,
    section,
)
from geoident.report.page.headed import PageHead, headed_page
from geoident.report.page.html import Html, tag
from geoident.report.text.layout import TextTable
from geoident.report.text.project.tables import (
    bands_table,
    common_table,
    laws_table,
    left_out_table,
    parameters_table,
    sections_table,
)
from geoident.report.text.project.tables import head as summary


def project_page(
    result: ProjectResult, head: ReportHead = NO_HEAD, *, logo: bytes = b"", draw: Draw = svg_files
) -> str:
    """The report of several sections as one page.

    Args:
        result: of their fit.
        head: what it says of itself.
        logo: content of the file of the logo.
        draw: makes the figures.
    """
    parts = (
        section(
            "Summary",
            tag("p", " ".join(summary(result).split()), class_="lead"),
            TitledTable("Common to all sections", common_table(result)),
            TitledTable("Laws, and how far sections scatter about them", laws_table(result)),
        ),
        section("Findings", _list(result.findings)),
        section("Laws", Figures(law_pictures(result))),
        section(
            "Sections",
            Figures(estimate_pictures(result)),
            TitledTable(
                "By the law, by itself, and with all others, with 95 % intervals",
                parameters_table(result),
            ),
            TitledTable(
                "Readings used, size of the residuals by their errors, and the probability of a "
                "section of the same ground to be as far from all others",
                sections_table(result),
            ),
        ),
        section("Predicted sections", *_predicted(result)),
        section("Left out in turn", *_left_out(result)),
        section("Notes", _list(result.notes)),
        section("Provenance", TitledTable("Where this comes from", _provenance(result))),
    )
    origin = result.provenance
    title = result.title or f"Project {origin.case_file}"
    version = origin.versions.get("geoident", "")
    return headed_page(PageHead(title, [origin.created], [version], head, logo), parts, draw)


def _list(sentences: tuple[str, ...]) -> Html:
    return tag("ul", *(tag("li", text) for text in sentences)) if sentences else tag("p", "None.")


def _predicted(result: ProjectResult) -> list[Figures | TitledTable]:
    """Bands of the sections that took no part."""
    names = {one.name for one in result.predicted}
    rows = [row for row in result.readings if row.section in names]
    if not rows:
        return []
    pictures = reading_pictures(rows, "predicted", "Readings of predicted sections")
    return [Figures(pictures), *(_table(result, one) for one in result.predicted)]


def _table(result: ProjectResult, one: SectionEnd) -> TitledTable:
    rows = [row for row in result.readings if row.section == one.name]
    return TitledTable(f"{one.name}: expected readings with 95 % bands", bands_table(rows))


def _left_out(result: ProjectResult) -> list[Figures | TitledTable]:
    """Each section as all others predict it."""
    rows = result.left_out_readings
    if not rows:
        return []
    pictures = reading_pictures(rows, "left-out", "Readings of sections as the others predict them")
    return [
        TitledTable("Each section as all others predict it", left_out_table(result)),
        Figures(pictures),
    ]


def _provenance(result: ProjectResult) -> TextTable:
    found = result.provenance
    rows = [
        ["project", found.case_file],
        *([one.name, one.case_file] for one in result.sections),
        ["cost", f"{result.counts.evaluations} evaluations, {result.counts.factorizations} "
         "factorizations"],
        ["identity", found.identity],
        *([name, text] for name, text in found.versions.items()),
    ]  # fmt: skip
    return TextTable(["", ""], rows)
