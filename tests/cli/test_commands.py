"""Every command says what it was asked for on stdout, and has examples."""

import csv
import json

import pytest

from geoident.cli.app import COMMANDS, geoident
from geoident.cli.options import Duration


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself_with_examples(run, name):
    told = run(name, "--help")
    assert told.exit_code == 0
    assert f"geoident {name}" in told.stdout.split("Examples:")[1]


def test_the_version_is_told(run):
    assert run("--version").stdout.startswith("geoident, version")


@pytest.mark.parametrize(
    "arguments",
    [["nonsense"], ["fit"], ["fit", "case.yaml", "--nonsense"], ["fit", "c", "--max-time", "10"]],
)
def test_wrong_flags(run, arguments):
    wrong = run(*arguments)
    assert wrong.exit_code == 2
    assert wrong.stdout == ""


@pytest.mark.parametrize(
    ("text", "seconds"), [("90s", 90), ("10min", 600), ("1h30min", 5400), ("1.5 h", 5400)]
)
def test_times_carry_their_unit(text, seconds):
    assert Duration().convert(text, None, None) == seconds


def test_a_file_that_is_not_there(run, tmp_path):
    for command in ("fit", "check", "simulate", "scan", "show", "predict"):
        missing = run(command, tmp_path / "nothing")
        assert missing.exit_code == 3, command
        assert "nothing" in missing.stderr


class TestCheck:
    def test_it_tells_what_the_case_amounts_to(self, trench, run):
        told = run("check", "case.yaml")
        assert told.exit_code == 0
        assert "plane-strain, 35 nodes, 24 elements" in told.stdout
        assert "-lower" in told.stdout
        assert "3 not used: the stage is not in fit.stages" in told.stdout
        assert "- first: CV S X.a used" in told.stdout
        assert "    not used: CV S X.a: the stage is not in fit.stages" in told.stdout
        assert "X.a       1, 3            13  rock              1.00" in told.stdout

    def test_it_tells_all_faults_at_once(self, trench, run):
        told = run("check", "case.yaml", "--set", "groups.rock=granite", "--set", "fit.stages=[x]")
        assert told.exit_code == 3
        assert "granite" in told.stderr
        assert "2 faults" in told.stderr
        assert told.stdout == ""

    def test_faults_that_need_the_mesh_name_their_line(self, trench, run):
        case = trench / "case.yaml"
        case.write_text(case.read_text().replace("left: x", "lift: x"))
        told = run("check", "case.yaml")
        assert told.exit_code == 3
        assert "case.yaml:11:" in told.stderr

    def test_it_says_where_no_factor_is_made(self, trench, run):
        assert "levels" not in run("check", "case.yaml").stdout
        told = " ".join(run("check", "case.yaml", "--solver", "iterative").stdout.split())
        assert "conjugate gradients on several levels take its place" in told
        assert "for one evaluation by iterative" in told

    def test_a_mechanism_is_found(self, trench, run):
        assert run("check", "case.yaml", "--set", "supports={}").exit_code == 5

    def test_objects(self, trench, run_json):
        good, bad = run_json("check", "case.yaml", "nothing.yaml")
        assert good["status"] == "valid"
        group = {"name": "rock", "material": "rock", "elements": 20, "volume": 20.0}
        assert good["groups"][0] == pytest.approx(group)
        heads = [place for place in good["places"] if place["point"] == [2.0, 3.0]]
        assert [place["channels"] for place in heads] == [["X.a"]]
        assert heads[0]["distance"] == pytest.approx(0.0)
        assert {"stage": "first", "used": ["CV", "S", "X.a"], "unused": [], "moments": 0} in good[
            "readings"
        ]
        assert good["cost"]["factor_entries"] > 300
        assert good["cost"]["seconds"] > 0
        assert bad["status"] == "failed"

    def test_some_of_several_cases(self, trench, run):
        assert run("check", "case.yaml", "nothing.yaml").exit_code == 7
        assert run("check", "case.yaml", "case.yaml").exit_code == 0

    def test_a_method_that_the_model_cannot_serve_is_refused(self, trench, run):
        told = run(
            "check", "case.yaml", "--set", "fit.method=condensation",
            "--set", "parameters.nu={start: 0.3, bounds: [0.1, 0.4]}",
            "--set", "materials.rock.nu=$nu", "--set", "fit.stages=[first, second]",
        )  # fmt: skip
        assert told.exit_code == 3
        assert "condensation is not possible" in told.stderr


class TestSimulate:
    def rows(self, text):
        return list(csv.DictReader(text.splitlines()))

    def test_readings_come_as_a_case_takes_them(self, trench, run):
        truth = ["--set", "parameters.E.start=5 GPa", "--set", "parameters.K0.start=1.5"]
        done = run("simulate", "case.yaml", *truth, "-o", "exact.csv")
        assert done.stdout == "exact.csv\n"
        assert run("fit", "case.yaml", "--set", "readings=exact.csv", "-q").exit_code == 0
        found = json.loads(run("show", "case.fit.h5", "--json").stdout)
        assert found["parameters"]["E"]["value"] == pytest.approx(5e9, rel=1e-6)
        assert found["objective"] < 1e-10

    def test_noise_is_that_of_the_gauge_and_repeats_with_its_seed(self, trench, run):
        exact = self.rows(run("simulate", "case.yaml").stdout)
        noisy = [run("simulate", "case.yaml", "--noise", "--seed", s).stdout for s in (1, 1, 2)]
        assert noisy[0] == noisy[1] != noisy[2]
        for one, other in zip(exact, self.rows(noisy[0]), strict=True):
            difference = float(one["value"]) - float(other["value"])
            assert 0 < abs(difference) < 0.05
            assert (one["gauge"], one["stage"]) == (other["gauge"], other["stage"])

    def test_a_file_is_not_overwritten(self, trench, run):
        before = (trench / "readings.csv").read_text()
        assert run("simulate", "case.yaml", "-o", "readings.csv").exit_code == 6
        assert (trench / "readings.csv").read_text() == before

    def test_earlier_ones_of_the_case_are_kept_beside(self, trench, run):
        assert run("simulate", "case.yaml", "-o", "simulated.csv").exit_code == 0
        assert run("simulate", "case.yaml", "-o", "simulated.csv").exit_code == 0
        assert not (trench / "simulated.1.csv").exists()  # the same once more
        before = (trench / "simulated.csv").read_text()
        assert "# Simulated by geoident, not measured." in before
        done = run("simulate", "case.yaml", "-o", "simulated.csv", "--noise")
        assert done.exit_code == 0
        assert "it is kept as simulated.1.csv" in done.stderr
        assert (trench / "simulated.1.csv").read_text() == before
        assert (trench / "simulated.csv").read_text() != before
        (trench / "simulated.csv").write_text(before.replace("-", "+", 1))
        stopped = run("simulate", "case.yaml", "-o", "simulated.csv")
        assert stopped.exit_code == 6
        assert "was changed since geoident made it" in stopped.stderr
        words = ("--set", "readings=simulated.1.csv")
        assert run("check", "case.yaml", *words).exit_code == 0

    def test_it_does_not_ask_for_readings(self, trench, run):
        (trench / "readings.csv").unlink()
        assert run("simulate", "case.yaml").exit_code == 0

    def test_an_object(self, trench, run_json):
        (found,) = run_json("simulate", "case.yaml")
        assert found["readings"][0].keys() == {"gauge", "stage", "value", "unit"}


class TestScan:
    def test_the_best_point_and_the_grid(self, trench, run, run_json):
        done = run("scan", "case.yaml", "--set", "fit.scan.points=5")
        assert done.exit_code == 0
        assert done.stdout == "case.scan.h5\n"
        (found,) = run_json("show", "case.scan.h5")
        objective = [phi for row in found["grid"]["objective"] for phi in row]
        assert len(objective) == 25
        assert found["objective"] == min(objective)
        assert "25 points" in run("show", "case.scan.h5").stdout


class TestPredict:
    @pytest.fixture
    def fitted(self, after):
        return after(("fit", "case.yaml"))

    def test_it_agrees_with_the_fit(self, fitted, run, run_json):
        assert run("predict", "case.fit.h5").stdout == "case.predict.h5\n"
        (fit,), (prediction,) = run_json("show", "case.fit.h5"), run_json("show", "case.predict.h5")
        for one, other in zip(fit["predictions"], prediction["predictions"], strict=True):
            assert one["gauge"] == other["gauge"]
            for key in ("mean", "sd"):
                assert one[key] == pytest.approx(other[key], rel=1e-9)
        assert "up to date" in run("predict", "case.fit.h5").stderr

    def test_stages_may_be_chosen(self, fitted, run, run_json):
        (found,) = run_json("predict", "case.fit.h5", "--stages", "first,second")
        assert {p["stage"] for p in found["predictions"]} == {"first", "second"}
        assert run("predict", "case.fit.h5", "--stages", "third").exit_code == 2

    def test_it_needs_neither_the_case_nor_its_readings_but_the_same_mesh(self, fitted, run):
        (fitted / "case.yaml").unlink()
        (fitted / "readings.csv").unlink()
        assert run("predict", "case.fit.h5").exit_code == 0
        assert "3 of 3 readings inside" in " ".join(run("show", "case.predict.h5").stdout.split())
        mesh = fitted / "trench.inp"
        mesh.write_text(mesh.read_text() + "** changed\n")
        changed = run("predict", "case.fit.h5", "--fresh")
        assert changed.exit_code == 3
        assert " ".join(changed.stderr.split()) == (
            "trench.inp: The mesh is not the one that the fit was made with. Run the fit again, "
            "or give the case to predict with --case."
        )

    def test_another_case_takes_the_parameters_by_name(self, fitted, run, run_json):
        new = (fitted / "case.yaml").read_text()
        new = new.replace("gauges:", "gauges:\n  N: {kind: settlement, point: [5 m, 4 m], "
                          "accuracy: 0.1 mm}")  # fmt: skip
        new = new.replace("K0: $K0", "K0: 1.4").replace("  K0: {start", "  # {start")
        (fitted / "new.yaml").write_text(new)
        (found,) = run_json("predict", "case.fit.h5", "--case", "new.yaml", "-o", "new.h5")
        assert found["case"] == "new.yaml"
        assert list(found["parameters"]) == ["E"]
        assert ("N", "second") in {(p["gauge"], p["stage"]) for p in found["predictions"]}

    def test_a_parameter_that_was_not_identified_is_a_fault(self, fitted, run):
        new = (fitted / "case.yaml").read_text()
        (fitted / "new.yaml").write_text(new.replace("E:  {", "D:  {").replace("$E", "$D"))
        refused = run("predict", "case.fit.h5", "--case", "new.yaml", "-o", "new.h5")
        assert refused.exit_code == 3
        assert "the fit knows no parameter 'D'" in refused.stderr

    def test_a_scan_is_no_fit(self, fitted, run):
        run("scan", "case.yaml", "--set", "fit.scan.points=3")
        assert run("predict", "case.scan.h5").exit_code == 3


class TestShow:
    def test_it_speaks_the_units_of_the_case_and_fits_a_terminal(self, fitted_trench, run):
        run("fit", "case.yaml", "--set", "fit.model_error=15 %", "-o", "error.fit.h5")
        assert "computed motion" in " ".join(run("show", "error.fit.h5").stdout.split())
        told = run("show", "case.fit.h5").stdout + run("show", "error.fit.h5").stdout
        assert "GPa" in told
        assert max(len(line) for line in told.splitlines()) <= 80

    def test_several_results_and_one_that_is_none(self, fitted_trench, run, run_json):
        assert run("show", "case.fit.h5", "case.yaml").exit_code == 7
        assert run("show", "case.yaml").exit_code == 3
        first, second = run_json("show", "case.fit.h5", "case.fit.h5")
        assert first == second
        assert first["case"] == "case.yaml"


def test_the_schema_is_json(run):
    assert json.loads(run("schema").stdout)["title"] == "geoident case"


def test_the_doctor_tells_versions_and_the_solver_in_use(run):
    assert "used" in run("doctor").stdout
    found = json.loads(run("doctor", "--json").stdout)
    assert found["picked"] in ("pardiso", "cholmod", "splu")
    assert found["picked_beyond"] == "iterative"
    assert found["memory"] > 0
    assert "used where a factor takes too much time or memory" in run("doctor").stdout
    extras = {extra["name"]: extra for extra in found["extras"]}
    assert set(extras) >= {"report", "ags", "full-space", "global", "ensemble"}
    assert extras["global"]["version"]
    assert extras["global"]["remedy"] == 'pip install "geoident[global]"'


def test_commands_are_all_there():
    assert set(COMMANDS) == set(geoident.list_commands(None))
