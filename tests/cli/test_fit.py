"""A fit keeps what it has, refuses to destroy, and says how it ended."""

import json
from pathlib import Path

import h5py
import pytest
from support.trench import READINGS

from geoident.workflow.estimating import estimate as fit_workflow
from geoident.workflow.running import outputs

E_UNKNOWN_STRESS = [
    "--set",
    "parameters.sv={start: 1 MPa, bounds: [0.1 MPa, 10 MPa], scale: log}",
    "--set",
    "in_situ.vertical=$sv",
]


def test_the_result_stands_beside_the_case_and_stdout_has_only_its_path(trench, run):
    done = run("fit", "case.yaml")
    assert done.exit_code == 0
    assert done.stdout == "case.fit.h5\n"
    assert "converged by gauss-newton" in done.stderr
    assert (trench / "case.fit.h5").exists()
    assert not list(trench.glob("*.checkpoint"))


def test_the_parameters_of_the_readings_come_back(trench, run_json):
    (found,) = run_json("fit", "case.yaml")
    assert found["status"] == "converged"
    for name, truth in (("E", 5e9), ("K0", 1.5)):
        parameter = found["parameters"][name]
        assert parameter["lower95"] < truth < parameter["upper95"]
        assert parameter["determined"]


def test_the_json_object_has_what_was_promised_in_si_units(trench, run_json):
    (found,) = run_json("fit", "case.yaml")
    promised = {"case", "status", "method", "reason", "output", "objective", "parameters", "gauges"}
    assert promised | {"counts"} <= found.keys()
    assert found["case"] == "case.yaml"
    assert found["output"] == "case.fit.h5"
    parameter = {"value", "unit", "sd", "lower95", "upper95", "at_bound", "determined"}
    assert parameter <= found["parameters"]["E"].keys()
    assert found["parameters"]["E"]["unit"] == "Pa"
    used = [gauge for gauge in found["gauges"] if gauge["used"]]
    assert [gauge["measured"] for gauge in used] == [-0.598e-3, -0.1226e-3, 0.0627e-3]
    assert {gauge["stage"] for gauge in used} == {"first"}
    assert found["counts"]["factorizations"] > 0


def test_stages_that_were_not_fitted_are_predicted_and_scored(trench, run_json):
    (found,) = run_json("fit", "case.yaml")
    assert {p["stage"] for p in found["predictions"]} == {"second"}
    assert all(p["lower95"] < p["measured"] < p["upper95"] for p in found["predictions"])
    assert any("3 of 3 readings inside" in note for note in found["notes"])


def test_a_result_of_the_same_input_is_kept(fitted_trench, run, monkeypatch):
    before = (fitted_trench / "case.fit.h5").read_bytes()
    monkeypatch.setattr(fit_workflow, "prepare", None)
    again = run("fit", "case.yaml")
    assert again.exit_code == 0
    assert again.stdout == "case.fit.h5\n"
    assert "up to date" in again.stderr
    assert (fitted_trench / "case.fit.h5").read_bytes() == before


def test_a_comment_in_the_case_does_not_make_its_result_old(fitted_trench, run):
    case = fitted_trench / "case.yaml"
    case.write_text(case.read_text() + "# a comment\n")
    assert "up to date" in run("fit", "case.yaml").stderr


def test_fresh_computes_again(fitted_trench, run):
    again = run("fit", "case.yaml", "--fresh")
    assert again.exit_code == 0
    assert "up to date" not in again.stderr


def change_case(trench):
    case = trench / "case.yaml"
    case.write_text(case.read_text().replace("nu: 0.25", "nu: 0.3"))


def change_mesh(trench):
    mesh = trench / "trench.inp"
    mesh.write_text(mesh.read_text() + "** changed\n")


def change_readings(trench):
    readings = trench / "readings.csv"
    readings.write_text(readings.read_text().replace("-0.598", "-0.6"))


@pytest.mark.parametrize("change", [change_case, change_mesh, change_readings])
def test_an_edited_case_is_fitted_and_the_old_result_is_kept_beside(fitted_trench, run, change):
    before = (fitted_trench / "case.fit.h5").read_bytes()
    change(fitted_trench)
    done = run("fit", "case.yaml")
    assert done.exit_code == 0
    assert done.stdout == "case.fit.h5\n"
    said = " ".join(done.stderr.split())
    assert "case.fit.h5 was made from other input: it is kept as case.fit.1.h5" in said
    assert (fitted_trench / "case.fit.1.h5").read_bytes() == before
    assert (fitted_trench / "case.fit.h5").read_bytes() != before
    assert "up to date" in run("fit", "case.yaml").stderr
    assert run("diff", "case.fit.1.h5", "case.fit.h5").exit_code in (0, 1)


def test_with_force_nothing_is_kept(fitted_trench, run):
    change_readings(fitted_trench)
    assert run("fit", "case.yaml", "--force").exit_code == 0
    assert [path.name for path in fitted_trench.glob("*.fit*.h5")] == ["case.fit.h5"]


def test_a_case_that_is_as_before_has_its_result_back_without_computing(
    fitted_trench, run, monkeypatch
):
    text = (fitted_trench / "case.yaml").read_text()
    first = (fitted_trench / "case.fit.h5").read_bytes()
    change_readings(fitted_trench)
    run("fit", "case.yaml")
    second = (fitted_trench / "case.fit.h5").read_bytes()
    (fitted_trench / "readings.csv").write_text(READINGS)
    assert (fitted_trench / "case.yaml").read_text() == text
    monkeypatch.setattr(fit_workflow, "prepare", None)
    again = run("fit", "case.yaml")
    assert again.exit_code == 0
    said = " ".join(again.stderr.split())
    assert "case.fit.1.h5 was made from this input: it is case.fit.h5 again" in said
    assert "what stood there is kept as case.fit.2.h5" in said
    assert (fitted_trench / "case.fit.h5").read_bytes() == first
    assert (fitted_trench / "case.fit.2.h5").read_bytes() == second
    assert not (fitted_trench / "case.fit.1.h5").exists()


def test_an_override_is_other_input(fitted_trench, run):
    assert run("fit", "case.yaml", "--set", "parameters.E.start=3 GPa").exit_code == 0
    assert (fitted_trench / "case.fit.1.h5").exists()


def test_a_dry_run_says_that_the_old_result_will_be_kept(fitted_trench, run):
    change_readings(fitted_trench)
    said = run("fit", "case.yaml", "--dry-run").stdout
    assert "Would write case.fit.h5\nand keep what stands there beside it" in said
    assert not (fitted_trench / "case.fit.1.h5").exists()


def test_a_result_of_another_case_or_command_is_not_touched(fitted_trench, run):
    (fitted_trench / "other.yaml").write_text((fitted_trench / "case.yaml").read_text())
    change_readings(fitted_trench)
    before = (fitted_trench / "case.fit.h5").read_bytes()
    for command in (("fit", "other.yaml"), ("scan", "case.yaml"), ("backtest", "case.yaml")):
        refused = run(*command, "-o", "case.fit.h5")
        assert refused.exit_code == 6
        said = " ".join(refused.stderr.split())
        assert "a result of another case or command; it is not overwritten" in said
        assert "--force" in said
    assert (fitted_trench / "case.fit.h5").read_bytes() == before
    assert run("fit", "case.yaml", "-o", "case.fit.h5").exit_code == 0  # its own, named
    assert (fitted_trench / "case.fit.1.h5").read_bytes() == before


def test_old_results_are_kept_within_bounds_but_never_one_that_took_long(trench, run, monkeypatch):
    monkeypatch.setattr(outputs, "KEPT", 2)
    start, said = "parameters.E.start={} GPa", ""
    for n in range(1, 6):
        said += run("fit", "case.yaml", "--set", start.format(n)).stderr
        if n == 1:
            with h5py.File("case.fit.h5", "r+") as file:
                assert 0.0 < file.attrs["seconds"] < 600.0
                file.attrs["seconds"] = 3600.0
    assert sorted(path.name for path in trench.glob("*.fit.?.h5")) == [
        "case.fit.1.h5", "case.fit.3.h5", "case.fit.4.h5",
    ]  # fmt: skip
    assert said.count("case.fit.2.h5, an older one, is removed") == 1


def test_the_old_result_stays_where_it_is_until_the_new_one_is_there(
    fitted_trench, run, monkeypatch
):
    before = (fitted_trench / "case.fit.h5").read_bytes()
    change_readings(fitted_trench)

    def die(*_, **__):
        assert (fitted_trench / "case.fit.h5").read_bytes() == before
        raise KeyboardInterrupt

    monkeypatch.setattr("geoident.io.result.file.hdf5_output", die)
    run("fit", "case.yaml")
    assert (fitted_trench / "case.fit.h5").read_bytes() == before
    assert (fitted_trench / "case.fit.1.h5").read_bytes() == before


def test_where_there_are_no_hard_links_the_old_result_is_copied(fitted_trench, run, monkeypatch):
    before = (fitted_trench / "case.fit.h5").read_bytes()
    change_readings(fitted_trench)
    link = Path.hardlink_to

    def none(self, target):
        if self.name == "case.fit.1.h5":
            raise NotImplementedError
        link(self, target)

    monkeypatch.setattr(Path, "hardlink_to", none)
    assert run("fit", "case.yaml").exit_code == 0
    assert (fitted_trench / "case.fit.1.h5").read_bytes() == before


def test_a_file_that_is_no_result_is_not_overwritten(trench, run):
    (trench / "case.fit.h5").write_text("my notes")
    assert run("fit", "case.yaml").exit_code == 6
    assert (trench / "case.fit.h5").read_text() == "my notes"


def test_an_input_is_never_overwritten(trench, run):
    before = (trench / "readings.csv").read_text()
    assert run("fit", "case.yaml", "-o", "readings.csv", "--force").exit_code == 6
    assert (trench / "readings.csv").read_text() == before


def test_a_place_that_cannot_be_written_is_refused_before_computing(trench, run, monkeypatch):
    monkeypatch.setattr(fit_workflow, "prepare", None)
    refused = run("fit", "case.yaml", "-o", "nowhere/case.fit.h5")
    assert refused.exit_code == 6
    assert "nowhere" in refused.stderr


def test_the_output_may_be_a_folder(trench, run):
    (trench / "results").mkdir()
    assert run("fit", "case.yaml", "-o", "results").stdout == f"{Path('results/case.fit.h5')}\n"


def test_what_is_not_determined_is_null_and_keeps_its_exit_code(trench, run, run_json):
    done = run("fit", "case.yaml", *E_UNKNOWN_STRESS)
    assert done.exit_code == 4
    assert "not determined" in done.stderr
    again = run("fit", "case.yaml", *E_UNKNOWN_STRESS)
    assert again.exit_code == 4
    assert "up to date" in again.stderr
    (found,) = run_json("fit", "case.yaml", *E_UNKNOWN_STRESS)
    assert found["status"] == "not-determined"
    loose = [q for q in found["parameters"].values() if not q["determined"]]
    assert loose
    assert all(q["value"] is None and q["sd"] is None for q in loose)
    assert "not determined" in run("show", "case.fit.h5").stdout


def test_fewer_readings_than_parameters_are_refused(trench, run):
    few = "readings=[{gauge: CV, stage: first, value: -0.6 mm}]"
    refused = run("fit", "case.yaml", "--set", few)
    assert refused.exit_code == 3
    assert "1 usable reading cannot determine 2 parameters (E, K0)" in refused.stderr


def test_beside_a_prior_fewer_readings_than_parameters_say_what_is_not_determined(trench, run_json):
    """One reading, three parameters, one prior: nothing is refused, and nothing is made up."""
    (found,) = run_json(
        *("fit", "case.yaml", "--set", "readings=[{gauge: CV, stage: first, value: -0.6 mm}]"),
        *("--set", "parameters.nu={start: 0.25, bounds: [0.1, 0.4]}"),
        *("--set", "materials.rock.nu=$nu"),
        *("--set", "parameters.K0={start: 1, bounds: [0.2, 4], prior: {mean: 1.5, sd: 0.1}}"),
    )
    assert (found["status"], found["exit_code"]) == ("not-determined", 4)
    assert not found["parameters"]["nu"]["determined"]
    assert found["parameters"]["K0"]["sd"] == pytest.approx(0.1, rel=0.05)


def test_a_model_that_moves_freely_has_no_solution(trench, run):
    refused = run("fit", "case.yaml", "--set", "supports={}")
    assert refused.exit_code == 5
    assert not (trench / "case.fit.h5").exists()


def test_a_run_out_of_time_is_written_and_goes_on(trench, run, run_json):
    (short,) = run_json("fit", "case.yaml", "--max-time", "0s")
    assert short["status"] == "out-of-budget"
    assert short["exit_code"] == 4
    assert (trench / "case.fit.checkpoint").exists()
    rest = run("fit", "case.yaml")
    assert rest.exit_code == 0
    assert "Going on from" in rest.stderr
    assert not (trench / "case.fit.checkpoint").exists()


def test_a_dry_run_tells_and_writes_nothing(trench, run):
    before = sorted(trench.iterdir())
    told = run("fit", "case.yaml", "--dry-run")
    assert told.exit_code == 0
    assert "Would write case.fit.h5" in told.stdout
    assert sorted(trench.iterdir()) == before


def test_a_case_may_come_from_stdin(trench, run):
    done = run("fit", "-", stdin=(trench / "case.yaml").read_text())
    assert done.exit_code == 0
    assert done.stdout == "stdin.fit.h5\n"
    assert run("predict", "stdin.fit.h5").exit_code == 0


def test_quiet_says_nothing_and_verbose_says_why_readings_are_not_used(trench, run):
    assert run("fit", "case.yaml", "-q").stderr == ""
    told = run("fit", "case.yaml", "-v", "--fresh").stderr
    assert "not used: CV, S, X.a at second: the stage is not in fit.stages" in told
    assert "gauss-newton 0:" in told


def test_a_bug_leaves_a_log_and_no_traceback(trench, run, monkeypatch):
    def fail(*_):
        raise ZeroDivisionError("nobody thought of it")

    monkeypatch.setattr(fit_workflow, "prepare", fail)
    failed = run("fit", "case.yaml")
    assert failed.exit_code == 1
    assert "Traceback" not in failed.stderr
    log = Path(failed.stderr.split("details are in ")[1].split(";")[0])
    assert "nobody thought of it" in log.read_text()
    log.unlink()


def test_faulty_input_is_an_object_as_well(trench, run, run_json):
    (found,) = run_json("fit", "case.yaml", "--set", "groups.rock=granite")
    assert found["status"] == "failed"
    assert found["exit_code"] == 3
    assert found["faults"][0]["path"].startswith("groups.rock")


class TestSeveralCases:
    @pytest.fixture
    def cases(self, trench):
        text = (trench / "case.yaml").read_text()
        (trench / "good.yaml").write_text(text)
        (trench / "bad.yaml").write_text(text.replace("rock: rock", "rock: granite"))
        return trench

    def test_one_that_fails_does_not_stop_the_others(self, cases, run):
        done = run("fit", "bad.yaml", "good.yaml", "-j", "1")
        assert done.exit_code == 7
        assert done.stdout == "good.fit.h5\n"
        assert "bad.yaml: invalid input" in done.stderr
        assert "granite" in done.stderr
        assert "1 of 2 cases done" in done.stderr

    @pytest.mark.usefixtures("in_this_process")
    def test_objects_come_in_the_order_of_the_cases(self, cases, run):
        done = run("fit", "case.yaml", "good.yaml", "-j", "2", "--json")
        assert done.exit_code == 0
        found = [json.loads(line)["case"] for line in done.stdout.splitlines()]
        assert found == ["case.yaml", "good.yaml"]

    @pytest.mark.usefixtures("in_this_process")
    def test_what_is_up_to_date_is_told_apart_and_asks_for_no_process(
        self, fitted_trench, cases, run, monkeypatch
    ):
        mixed = run("fit", "case.yaml", "good.yaml", "-j", "2")
        assert mixed.stdout == "case.fit.h5\ngood.fit.h5\n"
        assert "case.yaml: up to date\n" in mixed.stderr
        assert "good.yaml: done\n" in mixed.stderr
        assert "2 of 2 cases done (1 computed, 1 up to date)" in mixed.stderr
        with monkeypatch.context() as patch:
            patch.setattr("geoident.workflow.executing.processes.LocalProcesses", None)
            known = run("fit", "case.yaml", "good.yaml")
        assert "2 of 2 cases done (0 computed, 2 up to date)" in known.stderr
        readings = cases / "readings.csv"
        readings.write_text(readings.read_text() + "\n")
        other = run("fit", "case.yaml", "good.yaml", "-j", "1")
        assert "(2 computed, 0 up to date)" in other.stderr

    @pytest.mark.parametrize(
        "arguments",
        [
            ["case.yaml", "-"],
            ["case.yaml", "good.yaml", "-o", "one.h5"],
            ["good.yaml", "good.yaml"],
        ],
    )
    def test_cases_that_would_share_a_result_are_refused(self, cases, run, arguments):
        assert run("fit", *arguments).exit_code == 2
