"""The report of what many cases make together: of a campaign, or of a project of sections."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath

from geoident.model.results.findings import sentences_of
from geoident.model.results.head import NO_HEAD, ReportHead
from geoident.model.results.many.campaign import CampaignTable
from geoident.model.results.many.project import ProjectResult, SectionEnd
from geoident.report.drawing.campaign import campaign_pictures
from geoident.report.drawing.project import estimate_pictures, law_pictures, reading_pictures
from geoident.report.drawing.style import svg_files
from geoident.report.page.blocks import Draw, Figures, PagePart, TitledTable, section
from geoident.report.page.headed import headed_page
from geoident.report.page.html import Html, tag
from geoident.report.text.campaign.tables import (
    failed_table,
    outcome_sentences,
    runs_left_out,
    runs_table,
)
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


def page_of_many(
    content: CampaignTable | ProjectResult,
    head: ReportHead = NO_HEAD,
    *,
    logo: bytes = b"",
    draw: Draw = svg_files,
) -> str:
    """The report of a campaign or a project as one page.

    Args:
        content: the runs of the one, the result of the other.
        head: what it says of itself.
        logo: content of the file of the logo.
        draw: makes the figures.
    """
    origin: tuple[str, Mapping[str, str]]
    if isinstance(content, CampaignTable):
        title = content.title or f"Campaign {PurePosixPath(content.campaign_file).name}"
        parts, origin = _campaign(content), (content.created, content.versions)
    else:
        where = content.provenance
        title = content.title or f"Project {where.case_file}"
        parts, origin = _project(content), (where.created, where.versions)
    return headed_page(title, [origin], parts, draw, head, logo)


def _campaign(table: CampaignTable) -> tuple[PagePart, ...]:
    """What came out, what failed and why, all runs in a table."""
    left_out = runs_left_out(table)
    return (
        section(
            "Summary",
            tag("p", " ".join(outcome_sentences(table)), class_="lead"),
            Figures(campaign_pictures(table)),
        ),
        section("Failed runs", TitledTable("Runs without a result, and why", failed_table(table))),
        section(
            "Runs",
            *([tag("p", left_out)] if left_out else []),
            TitledTable("What varied, and what came out", runs_table(table)),
        ),
        section("Provenance", TitledTable("Where this comes from", _campaign_origin(table))),
    )


def _versions(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {text}" for name, text in sorted(versions.items()))


def _campaign_origin(table: CampaignTable) -> TextTable:
    hosts = sorted({run.host for run in table.runs if run.host})
    rows = [
        ["campaign", table.campaign_file],
        ["base case", table.case_file],
        ["command", table.command],
        ["machines", ", ".join(hosts) or "-"],
        ["versions", _versions(table.versions)],
    ]
    return TextTable(["", ""], rows)


def _project(result: ProjectResult) -> tuple[PagePart, ...]:
    """Laws, sections, what is predicted, what was left out in turn."""
    return (
        section(
            "Summary",
            tag("p", " ".join(summary(result).split()), class_="lead"),
            TitledTable("Common to all sections", common_table(result)),
            TitledTable("Laws, and how far sections scatter about them", laws_table(result)),
        ),
        section("Findings", _sentences(sentences_of(result.findings))),
        section("Laws", Figures(law_pictures(result))),
        section(
            "Sections",
            Figures(estimate_pictures(result)),
            TitledTable(
                "By the law, by its own fit, and with all others, with 95 % intervals",
                parameters_table(result),
            ),
            TitledTable(
                "Misfit (residuals by their errors), and chance of one ground to lie so far off",
                sections_table(result),
            ),
        ),
        section("Predicted sections", *_predicted(result)),
        section("Left out in turn", *_left_out(result)),
        section("Notes", _sentences(result.notes)),
        section("Provenance", TitledTable("Where this comes from", _project_origin(result))),
    )


def _sentences(sentences: tuple[str, ...]) -> Html:
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


def _project_origin(result: ProjectResult) -> TextTable:
    provenance = result.provenance
    cases: dict[str, list[str]] = {}
    for one in result.sections:
        cases.setdefault(one.case_file, []).append(one.name)
    rows = [
        ["project", provenance.case_file],
        *([f"case of {', '.join(names)}", case] for case, names in cases.items()),
        ["cost", f"{result.counts.evaluations} evaluations, {result.counts.factorizations} "
         "factorizations"],
        ["identity", provenance.identity],
        ["versions", _versions(provenance.versions)],
    ]  # fmt: skip
    return TextTable(["", ""], rows)
