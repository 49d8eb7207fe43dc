"""An export and a report beside a case that was fitted again: of which result they are."""

from pathlib import Path

import pytest

EDIT = ("--set", "parameters.E.start=3 GPa")
AGAIN = "`geoident export case.fit.h5` makes them again"


@pytest.mark.usefixtures("plain_pictures")
def test_a_new_fit_says_which_files_are_of_the_earlier_one(fitted_trench, run):
    assert "earlier result" not in run("fit", "case.yaml").stderr
    run("export", "case.fit.h5")
    run("export", "case.fit.h5", "--format", "vtu")
    run("report", "case.fit.h5")
    count = len([line for line in listing() if not line.startswith("#")])
    assert "earlier result" not in said(run("fit", "case.yaml"))  # up to date, and so are they
    again = said(run("fit", "case.yaml", *EDIT))
    assert f"{count} files in case.fit.export are of an earlier result: {AGAIN}" in again
    assert "case.fit.html shows an earlier result: `geoident report case.fit.h5`" in again

    run("export", "case.fit.h5")  # the tables, not the grids
    left = said(run("fit", "case.yaml", *EDIT))
    assert "up to date" in left
    grids = len(list(Path("case.fit.export").glob("*.vtu"))) + 1
    assert f"{grids} files in case.fit.export are of an earlier result" in left
    run("export", "case.fit.h5", "--format", "vtu")
    assert "earlier result" not in said(run("fit", "case.yaml", *EDIT))
    assert len([line for line in listing() if line.startswith("# Of the result")]) == 1


def test_what_the_user_wrote_there_is_not_named(fitted_trench, run):
    run("export", "case.fit.h5")
    Path("case.fit.export/notes.txt").write_text("mine")
    Path("case.fit.html").write_text("<p>mine</p>")
    count = len([line for line in listing() if not line.startswith("#")])
    again = said(run("fit", "case.yaml", *EDIT))
    assert f"{count} files in" in again
    assert "html" not in again


def listing():
    return Path("case.fit.export/case.fit.sha256").read_text().splitlines()


def said(done):
    return " ".join(done.stderr.split())
