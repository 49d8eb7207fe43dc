"""Several sections from Python: what may run, the page, the tables."""

from pathlib import Path

import pytest

from geoident import batch, export, fit_project, report
from geoident.errors import InputError, UsageError
from tests.support.external import PYTHON, SCRIPT
from tests.support.external import write_case as write_elsewhere
from tests.support.projects import SECTIONS, example
from tests.support.trench import write_case

HEAD = {"title": "Ten sections", "client": "Ground AG", "revision": "b"}


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Two sections by formulas, and a third that is predicted; nobody changes it."""
    return fit_project(example(tmp_path_factory.mktemp("project"), SECTIONS), jobs=1)


def test_a_project_runs_no_function_unasked(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    write_elsewhere(tmp_path, PYTHON, script=SCRIPT)
    project = tmp_path / "project.yaml"
    sections = "sections: [{name: A, case: case.yaml}, {name: B, case: case.yaml}]"
    project.write_text(f"format: geoident-project/1\n{sections}\nshared: [E, K0]\n")
    with pytest.raises(InputError, match="it is not trusted yet") as error:
        fit_project(project, jobs=1)
    assert "trust" in str(error.value)
    assert not project.with_suffix(".fit.h5").exists()
    assert set(fit_project(project, jobs=1, trust=True).common) == {"E", "K0"}


@pytest.mark.usefixtures("plain_pictures")
def test_its_page_is_written_under_its_head(fitted, tmp_path):
    page = report(fitted, head=HEAD)
    assert page == str(Path(fitted.path).with_suffix(".html"))
    text = Path(page).read_text(encoding="utf-8")
    for said in ("<h1>Ten sections</h1>", "<dd>Ground AG</dd>", "<dd>b</dd>", "exp(b * GSI)"):
        assert said in text
    assert report(fitted.path, output=tmp_path) == str(tmp_path / "project.fit.html")
    with pytest.raises(UsageError, match="A project has a page of its own"):
        report(fitted, fitted)


def test_its_tables_are_exported_as_those_of_a_case(fitted, tmp_path):
    written = export(fitted, output=tmp_path)
    assert written == fitted.export(tmp_path)
    assert len([name for name in written if name.endswith(".csv")]) == len(fitted.tables)
    with pytest.raises(UsageError, match="formats='csv' is all"):
        export(fitted.path, ["csv", "vtu"])


@pytest.mark.usefixtures("plain_pictures")
def test_a_campaign_has_its_page_too(tmp_path, here):
    write_case(tmp_path)
    campaign = tmp_path / "campaign.yaml"
    campaign.write_text(
        "format: geoident-campaign/1\ncase: case.yaml\ncommand: simulate\n"
        "variations: {product: {parameters.E.start: [2 GPa]}}\n"
    )
    found = batch(campaign, jobs=1)
    page = report(found, head=HEAD)
    assert page == str(Path(found.path) / "report.html")
    text = Path(page).read_text(encoding="utf-8")
    assert "<h1>Ten sections</h1>" in text
    assert "<dd>Ground AG</dd>" in text
    with pytest.raises(UsageError, match="A campaign has a page of its own"):
        report(found.path, tmp_path / "case.fit.h5")
