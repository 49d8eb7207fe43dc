"""A case for PEST: read by pyEMU, and driven as PEST++ does."""

import shlex
import warnings
from pathlib import Path

import numpy as np
import pytest

from geoident.workflow.running.jobs import build_model, load_inputs
from geoident.workflow.simulate import simulate, simulated_pairs
from tests.support.trench import CASE

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of parts for groundwater models, which need more packages
    import pyemu

PRIORS = CASE.replace(
    "scale: log}", "scale: log, prior: {mean: 4 GPa, sd: 1 GPa, kind: lognormal}}"
).replace("bounds: [0.2, 4]}", "bounds: [-1, 4], prior: {mean: 1.2, sd: 0.3}}")


def control(name="case.pest/case.pst"):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pyemu.Pst(name)


def run_through(folder, run, monkeypatch, **values):
    """One run as PEST makes it: template, command, instructions; what it reads, by name."""
    monkeypatch.chdir(folder)
    pst = control("case.pst")
    for name, value in values.items():
        pst.parameter_data.loc[name, "parval1"] = value
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pst.write_input_files()
        done = run(*shlex.split(pst.model_command[0])[1:])
        assert done.exit_code == 0, done.output
        return pst.process_output_files()["obsval"].to_dict(), done


def test_pyemu_reads_what_the_case_says(trench, run):
    (trench / "case.yaml").write_text(PRIORS)
    done = run("export", "case.yaml", "--format", "pest")
    assert done.exit_code == 0
    files = ["case.pst", "case.tpl", "case.ins", "case.prior.cov"]
    assert done.stdout.splitlines() == [f"case.pest/{name}" for name in files]
    pst = control()
    by = pst.parameter_data
    assert by.partrans.to_dict() == {"e": "log", "k0": "none"}
    assert by.loc["e", ["parval1", "parlbnd", "parubnd"]].tolist() == [4.0, 0.1, 50.0]
    assert by.parval1["k0"] == 1.2  # PEST++ draws around the start: that is the prior mean
    assert by.parchglim.to_dict() == {"e": "factor", "k0": "relative"}
    groups = pst.parameter_groups
    assert groups.loc[by.pargp["e"], ["inctyp", "derinc"]].tolist() == ["relative", 0.01]
    assert groups.loc[by.pargp["k0"], ["inctyp", "derinc"]].tolist() == ["absolute", 0.025]
    read = pst.observation_data
    assert read.loc["cv_first", ["obsval", "weight", "obgnme"]].tolist() == [-0.598, 100.0, "cv"]
    assert read.loc["x.a_second", ["obsval", "weight"]].tolist() == [0.282, 0.0]
    assert pst.nnz_obs_names == ["cv_first", "s_first", "x.a_first"]
    assert pst.pestpp_options["forecasts"].split(",") == ["cv_second", "s_second", "x.a_second"]


def test_priors_are_equations_and_a_covariance(trench, run):
    (trench / "case.yaml").write_text(PRIORS)
    run("export", "case.yaml", "--format", "pest")
    pst = control()
    equation = pst.prior_information.loc["prior_e"]
    left, right = equation.equation.split("=")
    assert left.split() == ["1.0", "*", "log(e)"]
    assert float(right) == pytest.approx(np.log10(4.0), rel=1e-12)
    assert float(equation.weight) == pytest.approx(np.log(10) / 0.25, rel=1e-12)
    covariance = pyemu.Cov.from_ascii("case.pest/case.prior.cov")
    assert covariance.row_names == ["e", "k0"]
    expected = [(0.25 / np.log(10)) ** 2, 0.3**2]
    assert np.diag(covariance.as_2d) == pytest.approx(expected, rel=1e-12)


def test_the_cycle_reads_what_is_simulated(trench, run, monkeypatch):
    assert run("export", "case.yaml", "--format", "pest").exit_code == 0
    overrides = ["parameters.E.start=5 GPa", "parameters.K0.start=1.5"]
    simulated = simulate("case.yaml", overrides=overrides)
    found, done = run_through("case.pest", run, monkeypatch, e=5.0, k0=1.5)
    assert done.stderr == ""
    expected = {f"{r.channel}_{r.stage}".lower(): 1e3 * r.value for r in simulated.readings}
    assert found == pytest.approx(expected, abs=1e-7)  # the last digit that is printed


def test_each_run_takes_the_place_of_the_one_before(trench, run, monkeypatch):
    run("export", "case.yaml", "--format", "pest")
    run_through("case.pest", run, monkeypatch, e=5.0)
    run_through(".", run, monkeypatch, e=6.0)
    assert sorted(path.name for path in Path().glob("*computed*")) == ["case.computed.csv"]


@pytest.mark.parametrize(
    ("old", "new"),
    [("CV:", '"C, ""V""~@#":'), ("{name: first", "{name: 'Phase 1, Süd'"), ("CV:", '"Köln 7":')],
)
def test_names_of_all_kinds_are_found(trench, run, monkeypatch, old, new):
    new = new.replace('""', '\\"')
    text = CASE.replace(old, new).replace("stages: [first]", "backtest: false")
    (trench / "case.yaml").write_text(text.replace("readings.csv", "[]"))
    done = run("export", "case.yaml", "--format", "pest")
    assert done.exit_code == 0, done.output
    simulated = simulate("case.yaml")
    found, _ = run_through("case.pest", run, monkeypatch)
    by_value = sorted(round(1e3 * r.value, 7) for r in simulated.readings)
    assert sorted(found.values()) == pytest.approx(by_value, abs=1e-7)


def test_what_is_simulated_is_known_before(trench):
    model = build_model(load_inputs("case.yaml"))
    readings = simulate("case.yaml").readings
    assert simulated_pairs(model) == tuple((r.channel, r.stage) for r in readings)


def test_shared_errors_are_a_covariance_and_said(trench, run):
    accuracy = "accuracy: {reading: 0.01 mm, zero: 0.02 mm}"
    (trench / "case.yaml").write_text(
        CASE.replace("accuracy: 0.01 mm}", f"{accuracy}}}", 1).replace("stages: [first], ", "")
    )
    done = run("export", "case.yaml", "--format", "pest")
    assert "readings share errors" in done.stderr
    pst, noise = control(), pyemu.Cov.from_ascii("case.pest/case.noise.cov")
    assert pst.pestpp_options["obscov"] == "case.noise.cov"
    assert sorted(noise.row_names) == sorted(pst.nnz_obs_names)
    at = {name: n for n, name in enumerate(noise.row_names)}
    matrix = noise.as_2d
    assert matrix[at["cv_first"], at["cv_first"]] == pytest.approx(
        1e-4 + 4e-4 + 1e-2
    )  # epoch: 0.1 mm
    assert matrix[at["cv_first"], at["cv_second"]] == pytest.approx(4e-4)
    assert matrix[at["cv_first"], at["s_first"]] == 0.0
    weight = pst.observation_data.loc["cv_first", "weight"]
    assert float(weight) == pytest.approx(0.0105**-0.5)


def test_what_pest_is_not_told_is_said(trench, run):
    (trench / "case.yaml").write_text(
        CASE.replace("scale: log}", "scale: log, prior: {mean: 4 GPa, sd: 1 GPa}}").replace(
            "mesh_error: false", "mesh_error: false, loss: huber"
        )
    )
    said = run("export", "case.yaml", "--format", "pest").stderr
    assert "K0 is without prior" in said
    assert "E is searched on the logarithm by geoident, and not by PEST" in said
    assert "robust loss of the case is left out" in said


def test_edited_files_stay(trench, run):
    run("export", "case.yaml", "--format", "pest")
    assert run("export", "case.yaml", "--format", "pest").exit_code == 0
    file = Path("case.pest/case.pst")
    file.write_text(file.read_text().replace("30 0.005", "0 0.005"))
    done = run("export", "case.yaml", "--format", "pest")
    assert (done.exit_code, "case.pst" in done.stderr) == (6, True)
    assert "0 0.005" in file.read_text()
    assert run("export", "case.yaml", "--format", "pest", "--force").exit_code == 0
    assert "30 0.005" in file.read_text()


@pytest.mark.parametrize(
    "words",
    [
        ("case.fit.h5", "--format", "pest"),
        ("case.yaml", "case.yaml", "--format", "pest"),
        ("case.yaml", "--format", "pest", "--format", "csv"),
        ("case.yaml", "--format", "pest", "--table", "gauges"),
        ("case.yaml", "--format", "pest", "-o", "../with blanks/pest"),
        ("-", "--format", "pest"),
    ],
)
def test_what_does_not_go_together_is_refused(trench, run, words):
    done = run("export", *words)
    assert done.exit_code == (0 if "../with blanks/pest" in words else 2), done.output


def test_a_path_with_blanks_is_refused(trench, run):
    (trench / "my case.yaml").write_text(CASE)
    done = run("export", "my case.yaml", "--format", "pest")
    assert (done.exit_code, "has blanks" in done.stderr) == (2, True)


TABLE = "parameter,value,unit\nE,5,GPa\nK0, 1.5D+00 ,\n"


def test_values_come_from_a_table(trench, run):
    (trench / "values.csv").write_text(TABLE)
    done = run("simulate", "case.yaml", "--values", "values.csv")
    same = run(
        "simulate", "case.yaml", "--set", "parameters.E.start=5 GPa",
        "--set", "parameters.K0.start=1.5",
    )  # fmt: skip
    assert done.stdout == same.stdout
    assert "--values values.csv" in done.stderr


def test_the_parameters_of_a_result_are_such_a_table(trench, run):
    run("fit", "case.yaml", "-q")
    run("export", "case.fit.h5", "--table", "parameters", "-o", "fitted.csv")
    done = run("simulate", "case.yaml", "--values", "fitted.csv")
    first = done.stdout.splitlines()[1].split(",")
    assert (first[:2], float(first[2])) == (["CV", "first"], pytest.approx(-0.5986, abs=1e-3))


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("", "values.csv: the table is empty"),
        ("name,value\n", "values.csv:1:1: there is no column 'parameter'"),
        ("parameter,value,unit\nE,5\n", "values.csv:2:1: found 2 cells"),
        ("parameter,value,unit\nF,5,GPa\n", "values.csv:2:1: there is no parameter 'F'"),
        ("parameter,value,unit\nE,5,GPa\nE,5,GPa\n", "values.csv:3:1: the parameter 'E' is"),
        ("parameter,value,unit\nE, five,GPa\n", "values.csv:2:4: 'five' is not a number"),
        ("parameter,value,unit\nE,5,\n", "values.csv:2:3: 'E' is a pressure and has no unit"),
        ("parameter,value,unit\nE,5,mm\n", "values.csv:2:5: 'mm' is not a unit of a pressure"),
        ("parameter,value,unit\nE,5,GPA7\n", "values.csv:2:5: "),
        ("parameter,value,unit\nE,60,GPa\n", "E = 60 is outside its bounds [0.1, 50] GPa"),
    ],
)
def test_faults_of_a_table_have_their_place(trench, run, table, said):
    (trench / "values.csv").write_text(table)
    done = run("simulate", "case.yaml", "--values", "values.csv")
    assert done.exit_code == 3
    assert said in done.stderr


def test_an_output_never_replaces_the_table(trench, run):
    (trench / "values.csv").write_text(TABLE)
    done = run("simulate", "case.yaml", "--values", "values.csv", "-o", "values.csv", "--force")
    assert done.exit_code == 6
    assert (trench / "values.csv").read_text() == TABLE
