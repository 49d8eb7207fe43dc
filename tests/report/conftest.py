from dataclasses import replace

import pytest

pytest.importorskip("matplotlib", reason='reports need matplotlib: pip install "geoident[report]"')

from geoident.report.drawing.style import image
from geoident.report.page import page
from tests.support.results import example_result


@pytest.fixture(scope="session")
def plane():
    return example_result(2, yielded=True)


@pytest.fixture(scope="session")
def solid():
    return example_result(3)


@pytest.fixture(scope="session")
def reports(plane, solid):
    """Pages by the kind of the model, and the figures that were drawn for them."""
    pages, figures = {}, {}
    for kind, result in (("plane", plane), ("solid", solid)):
        kept = figures[kind] = {}

        def keep(picture, suffix, kept=kept):
            def draw():
                kept[picture.name] = picture.draw()
                return kept[picture.name]

            return image(replace(picture, draw=draw), suffix)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(page, "image", keep)
            pages[kind] = page.report_page([("pit.fit", result)])
    return pages, figures


@pytest.fixture(scope="session")
def figures(reports):
    return reports[1]


@pytest.fixture(scope="session")
def plane_page(reports):
    return reports[0]["plane"]


@pytest.fixture(scope="session")
def solid_page(reports):
    return reports[0]["solid"]
