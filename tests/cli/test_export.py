"""A result as files for spreadsheets and for ParaView."""

import csv
import hashlib
import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from geoident.cli.commands.export import TABLES
from geoident.io.result.file import read_result
from geoident.report.text.csv_tables import CSV_TABLES


@pytest.fixture
def fitted(after):
    return after(("fit", "case.yaml", "-q"))


MISSING = (
    *("accuracies", "left-out", "grid", "structures", "backtest", "backtest-parameters"),
    *("posterior", "draws", "fields", "yielded", "alarms", "troughs", "convergence"),
    *("opening", "ground-reaction", "opening-stresses", "opening-supports"),
    *("face", "face-profile"),
    *("seasonal", "judged", "changes", "power", "decisions", "telling-readings", "plan"),
    *("plan-targets", "updates", "update-gauges", "update-readings", "update-parameters"),
    *("update-predictions", "parameter-changes", "times", "settlement", "shells", "interfaces"),
    "safety",
)
"""Tables of which a plain fit has nothing to say."""


def rows(text):
    return list(csv.DictReader(text.splitlines()))


def files(folder):
    return sorted(path.name for path in Path(folder).iterdir())


def exported(run, name):
    """The rows of one table."""
    return rows(run("export", "case.fit.h5", "--table", name).stdout)


def test_the_flag_knows_all_tables():
    assert TABLES == CSV_TABLES


def test_every_table_is_written_and_its_path_printed(fitted, run):
    done = run("export", "case.fit.h5")
    names = [name for name in CSV_TABLES if name not in MISSING]
    paths = [f"case.fit.export/case.fit.{name}.csv" for name in names]
    assert (done.exit_code, done.stdout.splitlines()) == (0, paths)
    written = [*(path.split("/")[1] for path in paths), "case.fit.sha256"]
    assert files("case.fit.export") == sorted(written)


def test_csv_has_the_units_of_the_case_and_agrees_with_json(fitted, run, run_json):
    (found,) = run_json("show", "case.fit.h5")
    judged = {
        (reading["gauge"], reading["stage"]): reading["standardized"]
        for reading in found["diagnostics"]["readings"]
    }
    table = {name: exported(run, name) for name in CSV_TABLES[:6]}
    E, K0 = table["parameters"]
    assert (E["parameter"], E["unit"], K0["unit"]) == ("E", "GPa", "")
    for name in ("value", "sd", "lower95", "upper95"):
        assert 1e9 * float(E[name]) == pytest.approx(found["parameters"]["E"][name], rel=1e-11)
    for row, reading in zip(table["gauges"], found["gauges"], strict=True):
        assert (row["gauge"], row["stage"]) == (reading["gauge"], reading["stage"])
        assert float(row["measured"]) == pytest.approx(1e3 * reading["measured"], rel=1e-11)
        assert row["used"] == ("yes" if reading["used"] else "no")
        in_sd = float(row["residual"]) / float(row["sd"])
        assert float(row["residual_in_sd"]) == pytest.approx(in_sd, rel=1e-9)
        assert reading["residual_in_sd"] == pytest.approx(in_sd, rel=1e-9)
        assert reading["residual"] == reading["measured"] - reading["computed"]
        if reading["used"]:  # without what other readings show of shared errors
            residual = judged[reading["gauge"], reading["stage"]]
            assert float(row["unexplained"]) == pytest.approx(residual, rel=1e-9)
            assert reading["unexplained"] == pytest.approx(residual, rel=1e-9)
    for row, predicted in zip(table["prediction"], found["predictions"], strict=True):
        assert float(row["upper95"]) == pytest.approx(1e3 * predicted["upper95"], rel=1e-11)
    result = read_result("case.fit.h5")
    assert len(table["history"]) == len(result.history)
    last = table["history"][-1]
    assert float(last["E [GPa]"]) == pytest.approx(float(E["value"]), rel=1e-9)
    assert float(table["correlation"][0]["K0"]) == pytest.approx(
        result.parameters.correlation[0, 1]
    )


def test_sensitivities_are_those_of_the_model(fitted, run):
    """Against a difference of two simulations, in the units that the table states."""
    table = exported(run, "sensitivity")
    assert {row["unit"] for row in table} == {"mm/GPa", "mm"}
    E, K0 = (float(row["value"]) for row in exported(run, "parameters"))
    h = 1e-4 * E

    def simulated(value):
        told = run("simulate", "case.yaml", "--set", f"parameters.E.start={value:.15g} GPa",
                   "--set", f"parameters.K0.start={K0:.15g}", "--json")  # fmt: skip
        found = json.loads(told.stdout)["readings"]  # with all digits, m
        return {(r["gauge"], r["stage"]): 1e3 * r["value"] for r in found}

    above, below = simulated(E + h), simulated(E - h)
    slopes = {(r["gauge"], r["stage"]): float(r["value"]) for r in table if r["parameter"] == "E"}
    for place, slope in slopes.items():
        assert (above[place] - below[place]) / (2 * h) == pytest.approx(slope, rel=1e-3, abs=1e-7)


def test_a_table_goes_to_a_file_and_a_missing_one_is_named(fitted, run):
    done = run("export", "case.fit.h5", "--table", "gauges", "-o", "g.csv")
    assert done.stdout == "g.csv\n"
    assert (fitted / "g.csv").read_text().startswith("gauge,stage,measured")
    (fitted / "g.csv").write_text("mine")
    assert run("export", "case.fit.h5", "--table", "gauges", "-o", "g.csv").exit_code == 6
    missing = run("export", "case.fit.h5", "--table", "grid")
    assert missing.exit_code == 2
    assert "it has parameters, gauges" in missing.stderr


def test_a_scan_has_its_grid(trench, run):
    run("scan", "case.yaml", "--set", "fit.scan.points=3", "-q")
    grid = rows(run("export", "case.scan.h5", "--table", "grid").stdout)
    assert list(grid[0]) == ["E [GPa]", "K0", "objective"]
    assert len(grid) == 9
    without = run("export", "case.scan.h5", "--format", "vtu")
    assert without.exit_code == 3
    assert "holds no displacements" in without.stderr
    assert not (trench / "case.scan.export").exists()


def test_show_prints_all_tables_as_csv(fitted, run):
    told = run("show", "case.fit.h5", "--csv").stdout
    blocks = dict(block.split("\n", 1) for block in told.split("# ")[1:])
    assert list(blocks) == [name for name in CSV_TABLES if name not in MISSING]
    alone = run("export", "case.fit.h5", "--table", "gauges").stdout
    assert blocks["gauges"].rstrip() == alone.rstrip()
    assert run("show", "case.fit.h5", "--csv", "--json").exit_code == 2


def test_another_fit_of_the_case_is_exported_over_the_first(fitted, run):
    words = ("export", "case.fit.h5", "-o", "out", "--format", "csv", "--format", "vtu")
    alone = ("export", "case.fit.h5", "--table", "gauges", "-o", "gauges.csv")
    assert run(*words).exit_code == 0
    assert run(*words).exit_code == 0  # the same once more
    assert run(*alone).exit_code == 0
    assert run(*alone).exit_code == 0
    before = (fitted / "out" / "case.fit.gauges.csv").read_text()
    case = fitted / "case.yaml"
    text = case.read_text()
    case.write_text(text.replace("accuracy: 0.01 mm", "accuracy: 0.02 mm"))
    assert run("fit", "case.yaml").exit_code == 0
    assert run(*words).exit_code == 0
    after = (fitted / "out" / "case.fit.gauges.csv").read_text()
    assert after != before
    assert run(*alone).exit_code == 0
    assert (fitted / "gauges.csv").read_text() == after
    assert (fitted / "out" / "case.fit.0.vtu").exists()
    listed = (fitted / "out" / "case.fit.sha256").read_text().splitlines()
    sums = dict(reversed(line.split("  ")) for line in listed if not line.startswith("#"))
    assert sorted(sums) == [name for name in files("out") if name != "case.fit.sha256"]
    for name, digest in sums.items():
        found = hashlib.sha256((fitted / "out" / name).read_bytes()).hexdigest()
        assert found == digest


def test_what_was_edited_among_exported_files_is_kept(fitted, run):
    run("export", "case.fit.h5", "-o", "out")
    run("export", "case.fit.h5", "--table", "gauges", "-o", "gauges.csv")
    listing = fitted / "out" / "case.fit.sha256"
    for edited in (fitted / "out" / "case.fit.gauges.csv", listing, fitted / "gauges.csv"):
        whole = edited.read_text()
        edited.write_text(whole.replace("e", "E", 1))
        one = ("--table", "gauges", "-o", "gauges.csv") if edited.parent == fitted else ()
        refused = run("export", "case.fit.h5", *(one or ("-o", "out")))
        assert refused.exit_code == 6
        assert edited.name in refused.stderr
        assert "--force replaces it" in refused.stderr
        assert edited.read_text() == whole.replace("e", "E", 1)
        edited.write_text(whole)
    assert run("export", "case.fit.h5", "-o", "out").exit_code == 0


def test_nothing_is_overwritten_without_force(fitted, run):
    run("export", "case.fit.h5", "-o", "out")
    mine = fitted / "out" / "case.fit.history.csv"
    for name in ("parameters", "gauges"):
        (fitted / "out" / f"case.fit.{name}.csv").unlink()
    mine.write_text("my notes")
    refused = run("export", "case.fit.h5", "-o", "out")
    assert refused.exit_code == 6
    assert "--force replaces it" in refused.stderr
    assert mine.read_text() == "my notes"
    assert not (fitted / "out" / "case.fit.parameters.csv").exists()
    assert run("export", "case.fit.h5", "-o", "out", "--force").exit_code == 0
    assert mine.read_text() != "my notes"


def test_a_folder_that_cannot_be_made(fitted, run):
    (fitted / "file").write_text("")
    refused = run("export", "case.fit.h5", "-o", "file/out")
    assert refused.exit_code == 6
    assert "a part of the path is a file" in refused.stderr


def test_states_for_paraview(fitted, run):
    done = run("export", "case.fit.h5", "--format", "vtu", "--format", "vtkhdf", "-o", "out")
    assert done.exit_code == 0
    assert files("out") == [
        "case.fit.0.vtu", "case.fit.1.vtu", "case.fit.2.vtu", "case.fit.pvd", "case.fit.sha256",
        "case.fit.vtkhdf",
    ]  # fmt: skip
    pvd = (fitted / "out" / "case.fit.pvd").read_text()
    assert 'timestep="2" part="0" name="second" file="case.fit.2.vtu"' in pvd
    with h5py.File("out/case.fit.vtkhdf") as copy, h5py.File("case.fit.h5") as result:
        one, other = copy["VTKHDF"], result["VTKHDF"]
        assert dict(one.attrs).keys() == dict(other.attrs).keys()
        np.testing.assert_array_equal(one["CellData/stress"], other["CellData/stress"])
        principal, stress = one["CellData/principal_stress"][()], one["CellData/stress"][()]
        np.testing.assert_allclose(principal.sum(axis=1), stress[:, :3].sum(axis=1), atol=1e-3)
        steps = one["Steps/CellDataOffsets"]
        np.testing.assert_array_equal(steps["principal_stress"], steps["stress"])


def test_beside_the_result_the_sidecar_stays_one_and_comes_back_when_lost(fitted, run):
    sidecar = fitted / "case.fit.vtkhdf"
    before = sidecar.read_bytes()
    for lose in (lambda: None, sidecar.unlink):
        lose()
        assert run("export", "case.fit.h5", "--format", "vtkhdf", "-o", ".").exit_code == 0
        assert sidecar.read_bytes() == before
    sidecar.write_text("mine")
    assert run("export", "case.fit.h5", "--format", "vtkhdf", "-o", ".").exit_code == 6
    assert sidecar.read_text() == "mine"


def test_several_results(fitted, run):
    (fitted / "b").mkdir()
    (fitted / "b" / "case.fit.h5").write_bytes((fitted / "case.fit.h5").read_bytes())
    assert run("export", "case.fit.h5", "b/case.fit.h5").exit_code == 0
    assert (fitted / "b" / "case.fit.export" / "case.fit.gauges.csv").exists()
    clash = run("export", "case.fit.h5", "b/case.fit.h5", "-o", "all")
    assert clash.exit_code == 2
    assert "would write the same files" in clash.stderr
    assert run("export", "case.fit.h5", "nothing.h5", "-o", "all").exit_code == 7
    assert run("export", "case.fit.h5", "b/case.fit.h5", "--table", "gauges").exit_code == 2


def test_what_is_not_determined_is_an_empty_cell(trench, run):
    free = ["--set", "parameters.sv={start: 1 MPa, bounds: [0.1 MPa, 10 MPa], scale: log}",
            "--set", "in_situ.vertical=$sv"]  # fmt: skip
    assert run("fit", "case.yaml", *free, "-q").exit_code == 4
    E, *_ = exported(run, "parameters")
    assert (E["parameter"], E["value"], E["sd"], E["determined"]) == ("E", "", "", "no")
    shown = json.loads(run("show", "case.fit.h5", "--json").stdout)
    assert shown["parameters"]["E"]["value"] is None


def test_xarray_opens_the_groups_of_a_result(fitted):
    xarray = pytest.importorskip("xarray", reason="needs xarray")
    pytest.importorskip("h5netcdf", reason="needs h5netcdf")
    with xarray.open_dataset("case.fit.h5", group="gauges", engine="h5netcdf") as gauges:
        assert float(gauges.measured.sel(gauge="CV", stage="first")) == pytest.approx(-0.598e-3)
    with xarray.open_dataset("case.fit.h5", group="sensitivity", engine="h5netcdf") as table:
        assert table.sensitivity.dims == ("gauge", "stage", "parameter")


def test_simulated_fields_are_written_beside_the_readings(trench, run):
    words = ("simulate", "case.yaml", "--fields", "start.vtkhdf")
    found = run(*words)
    assert found.exit_code == 0, found.stderr
    assert found.stdout.startswith("gauge,stage,value,unit")
    with h5py.File("start.vtkhdf") as file:
        group = file["VTKHDF"]
        motion = group["PointData/displacement"][:]
        assert group["Steps"].attrs["NSteps"] == 3
    assert np.abs(motion).max() > 1e-4
    again = run(*words)
    assert (again.exit_code, "start.vtkhdf" in again.stderr) == (6, True)
    assert run(*words, "--force").exit_code == 0


def test_simulated_fields_have_their_principal_stresses_in_vtk(trench, run):
    reason = "needs vtk"
    hdf = pytest.importorskip("vtkmodules.vtkIOHDF", reason=reason)
    to_numpy = pytest.importorskip("vtkmodules.util.numpy_support", reason=reason).vtk_to_numpy
    assert run("simulate", "case.yaml", "--fields", "start.vtkhdf").exit_code == 0
    reader = hdf.vtkHDFReader()
    reader.SetFileName("start.vtkhdf")
    reader.UpdateInformation()
    for state in range(3):
        reader.UpdateTimeStep(float(state))
        cells = reader.GetOutputDataObject(0).GetCellData()
        stress, values, first, third = (
            to_numpy(cells.GetArray(name))
            for name in ("stress", "principal_stress", "principal_direction_1",
                         "principal_direction_3")
        )  # fmt: skip
        tensors = stress[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3)
        known = np.isfinite(stress).all(axis=1)
        assert known.sum() > 10
        assert state == 0 or np.ptp(values[known]) > 1e5
        close = {"rtol": 1e-9, "atol": 1e-3}  # Pa
        expected = np.linalg.eigvalsh(tensors[known])[:, ::-1]
        np.testing.assert_allclose(values[known], expected, **close)
        for direction, k in ((first, 0), (third, 2)):
            n = direction[known]
            np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0)
            pulled = np.einsum("qij,qj->qi", tensors[known], n)
            np.testing.assert_allclose(pulled, values[known, k : k + 1] * n, **close)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-o", "a.h5"), "readings are written as a table"),
        (("--fields", "a.csv"), "fields are written as VTKHDF"),
        (("--fields", "a.vtkhdf", "--reduced", "b.h5"), "knows readings and no fields"),
    ],
)
def test_a_simulation_is_not_written_under_a_name_of_another_kind(trench, run, words, said):
    found = run("simulate", "case.yaml", *words)
    assert found.exit_code == 2
    assert said in " ".join(found.stderr.split())
