from dataclasses import replace

import pytest

pytest.importorskip("matplotlib", reason='reports need matplotlib: pip install "geoident[report]"')

from matplotlib.figure import Figure

from geoident.report.drawing.style import image
from geoident.report.page.page import report_page
from tests.support.results import example_result


@pytest.fixture(scope="session")
def plane():
    return example_result(2, yielded=True)


@pytest.fixture(scope="session")
def solid():
    return example_result(3)


AS_IN_A_PLANE = {
    "parameters", "pairs", "readings-1", "extensometers-1", "one-to-one", "residuals", "history",
    "correlation", "section-1-displacement-parts", "section-1-stress-minimum",
    "section-1-stress-maximum", "section-1-stress-crosses", "section-1-deformed",
    "section-1-vectors", "section-2-displacement", "section-2-stress-minimum",
    "section-2-stress-maximum", "section-2-stress-crosses", "section-2-displacement-parts",
}  # fmt: skip
"""Figures of the solid ground that differ from those of the plane by nothing that is drawn anew."""


def nothing():
    """A figure that costs nothing."""
    return Figure(figsize=(1.0, 1.0), layout="none")


def drawn_page(result, *, blank=frozenset()):
    """A page, and the figures that were drawn for it, by their names.

    Args:
        result: whose page it is.
        blank: names of figures that are blank in it.
    """
    kept = {}

    def keep(picture):
        def draw():
            kept[picture.name] = picture.draw()
            return kept[picture.name]

        return image(replace(picture, draw=nothing if picture.name in blank else draw), "svg")

    text = report_page([("pit.fit", result)], draw=lambda pictures: [keep(p) for p in pictures])
    return text, kept


@pytest.fixture(scope="session")
def reports(plane, solid):
    """Pages with their figures, by the kind of the model.

    That of the solid ground has blanks in place of `AS_IN_A_PLANE`.
    """
    return {"plane": drawn_page(plane), "solid": drawn_page(solid, blank=AS_IN_A_PLANE)}


@pytest.fixture(scope="session")
def figures(reports):
    return {kind: drawn for kind, (_, drawn) in reports.items()}


@pytest.fixture(scope="session")
def plane_page(reports):
    return reports["plane"][0]


@pytest.fixture(scope="session")
def solid_page(reports):
    return reports["solid"][0]


@pytest.fixture(scope="session")
def whole_solid(solid):
    """The page of the solid ground with all its figures; slow."""
    return drawn_page(solid)


@pytest.fixture(scope="session")
def whole_solid_page(whole_solid):
    return whole_solid[0]
