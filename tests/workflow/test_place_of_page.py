"""Where the page of a result, a campaign or a project goes."""

import pytest

from geoident.errors import UsageError
from geoident.workflow.page_of_many import write_page_of_many
from geoident.workflow.running.remade import place_of_page


def test_a_page_goes_beside_into_a_folder_or_to_a_file(tmp_path):
    beside = tmp_path / "case.fit.html"
    (tmp_path / "pages").mkdir()
    assert place_of_page(None, beside) == beside
    assert place_of_page(str(tmp_path / "pages"), beside) == tmp_path / "pages" / "case.fit.html"
    assert place_of_page(str(tmp_path / "mine.html"), beside) == tmp_path / "mine.html"


def test_a_page_is_not_written_to_stdout(tmp_path):
    with pytest.raises(UsageError, match="A page cannot be written to stdout"):
        place_of_page("-", tmp_path / "case.fit.html")
    with pytest.raises(UsageError, match="give a file or a folder"):
        write_page_of_many("no-project.h5", "-", force=False, logo="", render=lambda _: "")
