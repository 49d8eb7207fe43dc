"""``geoident report`` as a command: what it writes where, and what it refuses."""

import sys
from dataclasses import replace

import pytest
from click.testing import CliRunner

from geoident.cli.app import geoident
from geoident.errors import ExitCode, InputError, OutputError, UsageError
from geoident.io.result.file import write_result
from geoident.io.text.campaign_folder import JOURNAL
from geoident.workflow.report import page_path, read_results
from tests.support.results import small_result


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_result(small_result(), tmp_path / "pit.fit.h5", overwrite=False)
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(geoident, ["report", *map(str, arguments)])


def refused(*arguments):
    found = run(*arguments)
    assert isinstance(found.exception, SystemExit)
    return found.exit_code, found.stderr


def test_the_page_stands_beside_the_result(folder):
    found = run("pit.fit.h5")
    assert (found.exit_code, found.stdout) == (0, "pit.fit.html\n")
    assert "<h1>Trial pit</h1>" in (folder / "pit.fit.html").read_text(encoding="utf-8")
    assert sorted(p.name for p in folder.iterdir()) == ["pit.fit.h5", "pit.fit.html"]


@pytest.mark.usefixtures("plain_pictures")
def test_the_same_page_is_left_and_what_somebody_wrote_is_kept_unless_forced(folder):
    run("pit.fit.h5")
    page = folder / "pit.fit.html"
    first, stamp = page.read_bytes(), page.stat().st_mtime_ns
    assert run("pit.fit.h5").exit_code == 0
    assert (page.read_bytes(), page.stat().st_mtime_ns) == (first, stamp)
    page.write_text("notes of somebody")
    code, message = refused("pit.fit.h5")
    assert code == ExitCode.OUTPUT
    assert "pit.fit.html" in message
    assert "--force" in message
    assert page.read_text() == "notes of somebody"
    assert run("pit.fit.h5", "--force").exit_code == 0
    assert page.read_bytes() == first


@pytest.mark.usefixtures("plain_pictures")
def test_an_edited_case_gets_a_new_page_in_place_of_the_old_one(folder):
    words = ("pit.fit.h5", "--figures", "figures", "--format", "png")
    run(*words)
    page, figure = folder / "pit.fit.html", folder / "figures/scan.png"
    old, drawn = page.read_bytes(), figure.read_bytes()
    other = small_result()
    write_result(replace(other, objective=9.9), folder / "pit.fit.h5", overwrite=True)
    assert run(*words).exit_code == 0
    assert page.read_bytes() != old
    assert figure.read_bytes() == drawn
    assert run("pit.fit.h5", "--client", "Ground AG").exit_code == 0  # nor does a new head stop


@pytest.mark.usefixtures("plain_pictures")
@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda page: page.replace(b"<h1>", b"<h1>Draft: "), "was changed since geoident made it"),
        (lambda page: page.rpartition(b"<!--")[0], "this version of geoident did not make it"),
    ],
)
def test_a_page_that_was_edited_is_kept_and_so_is_that_of_another_case(folder, change, why):
    run("pit.fit.h5")
    page = folder / "pit.fit.html"
    edited = change(page.read_bytes())
    page.write_bytes(edited)
    code, message = refused("pit.fit.h5", "--figures", "figures")
    assert code == ExitCode.OUTPUT
    assert why in message
    assert page.read_bytes() == edited
    page.unlink()
    run("pit.fit.h5")
    made = page.read_bytes()
    (folder / "b").mkdir()
    write_result(small_result(), folder / "b/pit.fit.h5", overwrite=False)
    code, message = refused("b/pit.fit.h5", "-o", "pit.fit.html")
    assert code == ExitCode.OUTPUT
    assert "was made of another case (case.yaml)" in message
    assert page.read_bytes() == made


@pytest.mark.usefixtures("plain_pictures")
def test_one_figure_of_somebody_stops_all_before_any_is_written(folder):
    run("pit.fit.h5", "--no-page", "--figures", "figures", "--format", "png")
    place = folder / "figures"
    (place / "parameters.png").write_bytes(b"mine")
    (place / "readings-1.png").unlink()
    code, message = refused("pit.fit.h5", "--no-page", "--figures", "figures", "--format", "png")
    assert code == ExitCode.OUTPUT
    assert "figures/parameters.png" in message
    assert not (place / "readings-1.png").exists()


@pytest.mark.usefixtures("plain_pictures")
def test_figures_come_as_files_in_every_format(folder):
    found = run("pit.fit.h5", "--no-page", "--figures", "figures/new", "--format", "png",
                "--format", "pdf")  # fmt: skip
    assert found.exit_code == 0
    names = found.stdout.split()
    assert {"figures/new/scan.png", "figures/new/scan.pdf"} <= set(names)
    starts = {"png": b"\x89PNG", "pdf": b"%PDF"}
    for name in names:
        assert (folder / name).read_bytes().startswith(starts[name[-3:]])
    assert not (folder / "pit.fit.html").exists()


def test_flags_that_make_no_sense_are_refused(folder):
    for flags, words in (
        (["--no-page"], "--figures DIR"),
        (["--no-page", "--figures", "x", "-o", "y.html"], "drop one"),
        (["--format", "png"], "--figures DIR"),
        (["-o", "-"], "stdout"),
    ):
        code, message = refused("pit.fit.h5", *flags)
        assert code == ExitCode.USAGE
        assert words in message


@pytest.mark.usefixtures("plain_pictures")
def test_a_missing_result_and_a_missing_folder_are_named(folder):
    assert refused("nothing.h5")[0] == ExitCode.INVALID_INPUT
    code, message = refused("pit.fit.h5", "-o", "nowhere/page.html")
    assert code == ExitCode.OUTPUT
    assert "nowhere" in message
    (folder / "taken").write_text("a file")
    assert refused("pit.fit.h5", "--no-page", "--figures", "taken")[0] == ExitCode.OUTPUT


def test_without_matplotlib_the_remedy_is_named(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, message = refused("pit.fit.h5")
    assert code == ExitCode.USAGE
    assert 'pip install "geoident[report]"' in message


def test_places_and_labels(folder):
    assert page_path(["a/x.fit.h5", "b/x.fit.h5"], output=None) == "a/comparison.html"
    assert page_path(["x.fit.h5"], output=str(folder)) == (folder / "x.fit.html").as_posix()
    with pytest.raises(OutputError, match="input"):
        page_path(["pit.fit.h5"], output="pit.fit.h5")
    with pytest.raises(UsageError):
        page_path(["pit.fit.h5"], output="-")
    (folder / "b").mkdir()
    (folder / "b/pit.fit.h5").write_bytes((folder / "pit.fit.h5").read_bytes())
    labels = [label for label, _ in read_results(["pit.fit.h5", "b/pit.fit.h5"])]
    assert labels == ["pit.fit.h5", "b/pit.fit.h5"]
    with pytest.raises(InputError):
        read_results(["c.h5"])


def test_a_campaign_is_reported_alone_and_without_figures_beside_its_page(folder):
    (folder / "many.batch").mkdir()
    (folder / "many.batch" / JOURNAL).write_text("")
    code, message = refused("many.batch", "--figures", "figures")
    assert (code, "drop --figures" in message) == (ExitCode.USAGE, True)
    code, message = refused("pit.fit.h5", "many.batch")
    assert (code, "report it alone" in message) == (ExitCode.USAGE, True)
    assert not (folder / "figures").exists()
