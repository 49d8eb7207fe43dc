"""``geoident report`` as a command: what it writes where, and what it refuses."""

import sys

import pytest
from click.testing import CliRunner

from geoident.cli.app import geoident
from geoident.errors import ExitCode, InputError, OutputError, UsageError
from geoident.io.result.file import write_result
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


def test_the_same_page_is_left_and_another_one_kept_unless_forced(folder):
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
