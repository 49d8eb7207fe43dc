"""The report of a campaign: what came out, what failed and why, all runs in a table."""

from __future__ import annotations

from pathlib import PurePosixPath

from geoident.model.results.head import NO_HEAD, ReportHead
from geoident.model.results.many.campaign import CampaignTable
from geoident.report.drawing.campaign import campaign_pictures
from geoident.report.drawing.style import svg_files
from geoident.report.page.blocks import Draw, Figures, TitledTable, section
from geoident.report.page.headed import PageHead, headed_page
from geoident.report.page.html import tag
from geoident.report.text.campaign.tables import (
    failed_table,
    outcome_sentences,
    runs_left_out,
    runs_table,
)
from geoident.report.text.layout import TextTable


def campaign_page(
    table: CampaignTable, head: ReportHead = NO_HEAD, *, logo: bytes = b"", draw: Draw = svg_files
) -> str:
    """The report of a campaign as one page.

    Args:
        table: its runs.
        head: what it says of itself.
        logo: content of the file of the logo.
        draw: makes the figures.
    """
    left_out = runs_left_out(table)
    parts = (
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
        section("Provenance", TitledTable("Where this comes from", _provenance(table))),
    )
    title = table.title or f"Campaign {PurePosixPath(table.campaign_file).name}"
    version = table.versions.get("geoident", "")
    return headed_page(PageHead(title, [table.created], [version], head, logo), parts, draw)


def _provenance(table: CampaignTable) -> TextTable:
    hosts = sorted({run.host for run in table.runs if run.host})
    rows = [
        ["campaign", table.campaign_file],
        ["base case", table.case_file],
        ["command", table.command],
        ["machines", ", ".join(hosts) or "-"],
        *([name, text] for name, text in table.versions.items()),
    ]
    return TextTable(["", ""], rows)
