"""What was made from an earlier fit says so, and a fit says what stands beside it."""

import json
from dataclasses import replace

import pytest
from click.testing import CliRunner
from support.external import OWN, READINGS

from geoident.cli.app import geoident
from geoident.io.result.file import read_identity, read_result
from tests.support.commands import said_findings


def run(*words):
    found = CliRunner().invoke(geoident, [*map(str, words)])
    assert found.exit_code == 0, found.output
    return found.output


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A case, its fit, a prediction and a report, and then another fit."""
    folder = tmp_path_factory.mktemp("site")
    text = OWN.replace("backtest: false", "backtest: false\n  stages: [half]")
    (folder / "case.yaml").write_text(text)
    readings = READINGS
    for name in "HVD":
        readings = readings.replace(f"\n{name},", f"\n{name}.a,")
    (folder / "readings.csv").write_text(readings)
    return folder


def fit_all(folder):
    said = run("fit", folder / "case.yaml")
    for command in ("predict", "report"):
        run(command, folder / "case.fit.h5")
    return said


@pytest.mark.usefixtures("plain_pictures")
def test_of_a_newer_fit_what_stands_beside_it_is_named(site):
    folder, case = site, site / "case.yaml"
    assert "earlier fit" not in fit_all(folder)
    fit, made = (read_result(str(folder / f"case.{kind}.h5")) for kind in ("fit", "predict"))
    assert made.provenance.fit_file == "case.fit.h5"
    assert made.provenance.fit_fingerprint == fit.fingerprint
    assert read_identity(folder / "case.fit.h5").fingerprint == fit.fingerprint
    for name in ("predict", "fit"):
        assert "earlier fit" not in run("show", folder / f"case.{name}.h5")
        assert "outdated" not in json.loads(run("show", "--json", folder / f"case.{name}.h5"))

    case.write_text(case.read_text().replace("nu: 0.25", "nu: 0.2"))
    predicted, page = str(folder / "case.predict.h5"), str(folder / "case.fit.html")
    said = run("fit", case)
    assert f"{predicted} and {page} are of an earlier fit: make them again." in said
    assert f"{predicted} and {page} are of" in run("show", folder / "case.fit.h5")
    assert json.loads(run("show", "--json", folder / "case.fit.h5"))["outdated"] == [
        predicted,
        page,
    ]
    shown = run("show", predicted)
    fit_now = folder / "case.fit.h5"
    assert f"Outdated: made from an earlier fit than {fit_now} holds now." in " ".join(
        shown.split()
    )
    found = json.loads(run("show", "--json", predicted))
    assert found["outdated"] == [predicted]
    assert f"`geoident predict {fit_now}` makes it again" in said_findings(found)[0]
    run("report", predicted, "-o", folder / "old.html")
    assert "Outdated: made from an earlier fit" in (folder / "old.html").read_text()

    fit_all(folder)
    for name in ("predict", "fit"):
        assert "earlier fit" not in run("show", folder / f"case.{name}.h5")
    (folder / "case.fit.h5").unlink()
    assert "earlier fit" not in run("show", predicted)


@pytest.mark.usefixtures("plain_pictures")
def test_a_fit_that_was_cut_short_is_another_one_of_the_same_input(site):
    fit_all(site)
    fit = read_result(str(site / "case.fit.h5"))
    other = replace(fit, status="out-of-budget", objective=fit.objective + 1.0)
    assert other.provenance.identity == fit.provenance.identity
    assert other.fingerprint != fit.fingerprint
