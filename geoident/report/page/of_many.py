"""The report of what many cases make together."""

from __future__ import annotations

from geoident.model.results.head import ReportHead
from geoident.model.results.many.campaign import CampaignTable
from geoident.model.results.many.project import ProjectResult
from geoident.report.drawing.style import svg_files
from geoident.report.page.blocks import Draw
from geoident.report.page.campaign import campaign_page
from geoident.report.page.project import project_page


def page_of_many(
    content: CampaignTable | ProjectResult,
    head: ReportHead,
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
    if isinstance(content, CampaignTable):
        return campaign_page(content, head, logo=logo, draw=draw)
    return project_page(content, head, logo=logo, draw=draw)
