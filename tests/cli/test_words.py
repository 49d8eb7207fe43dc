"""What the commands say around their work: help, typos, what comes next, and notes."""

from __future__ import annotations

import shlex

import pytest
from support.trench import CASE, READINGS

from geoident.cli.app import COMMANDS
from geoident.io.docs.templates import TEMPLATES
from geoident.io.text.wording import OTHER_WORDS, did_you_mean
from geoident.model.gauges import named_channels


def next_steps(told):
    return [line.strip() for line in told.stderr.partition("Next:\n")[2].splitlines() if line]


class TestHelp:
    @pytest.mark.parametrize("command", ["", *COMMANDS])
    def test_no_line_is_cut_or_wider_than_a_terminal(self, run, monkeypatch, command):
        monkeypatch.setenv("COLUMNS", "80")
        text = run(*([command] if command else []), "--help").stdout
        assert max(map(len, text.splitlines())) <= 80
        assert "..." not in text.replace("CASE...", "").replace("RESULT...", "").replace(
            "[ARGS]...", ""
        )
        assert str(2**63 - 1) not in text

    def test_templates_stand_apart_from_what_they_are(self, run, monkeypatch):
        monkeypatch.setenv("COLUMNS", "80")
        lines = run("init", "--help").stdout.splitlines()
        for name, about in TEMPLATES.items():
            (line,) = [line for line in lines if line.split()[:1] == [name]]
            assert line.split(None, 1)[1] == about


class TestTypos:
    @pytest.mark.parametrize(
        ("typed", "meant"),
        [
            (("fti", "case.yaml"), "fit"),
            (("chekc", "case.yaml"), "check"),
            (("init", "x", "--template", "caven"), "cavern"),
            (("fit", "case.yaml", "--solver", "colmod"), "cholmod"),
            (("export", "case.fit.h5", "--table", "readngs"), "readings"),
            (("export", "case.fit.h5", "--format", "vtk"), "vtu"),
            (("completion", "bsh"), "bash"),
        ],
    )
    def test_the_nearest_word_is_proposed(self, run, typed, meant):
        told = run(*typed)
        assert told.exit_code == 2
        assert f"Did you mean '{meant}'?" in told.stderr

    def test_of_nothing_near_all_commands_are_told(self, run):
        told = run("identify")
        assert told.exit_code == 2
        assert "There is no command 'identify'. The commands are init, check" in told.stderr

    def test_what_others_call_a_gauge_is_known(self):
        kinds = ["extensometer", "convergence", "piezometer", "inclinometer", "tilt"]
        assert did_you_mean("pore-pressure", kinds) == "Did you mean 'piezometer'?"
        assert did_you_mean("piezometers", kinds) == "Did you mean 'piezometer'?"
        assert did_you_mean("tiltmeter", kinds) == "Did you mean 'tilt'?"
        assert all(word == word.lower() for word in OTHER_WORDS)


class TestNext:
    def test_a_case_without_readings_is_planned_or_simulated(self, trench, run):
        text = (trench / "case.yaml").read_text().replace("readings: readings.csv\n", "")
        (trench / "case.yaml").write_text(text)
        change = ("--set", "parameters.E.start=3 GPa")
        steps = next_steps(run("check", "case.yaml", *change))
        assert [shlex.split(step)[1:] for step in steps] == [
            ["check", "case.yaml", *change, "--identifiability"],
            ["simulate", "case.yaml", *change],
        ]
        for step in steps:
            assert run(*shlex.split(step)[1:]).exit_code == 0
        planned = next_steps(run("check", "case.yaml", "--identifiability"))
        assert planned[0] == "geoident simulate case.yaml"

    def test_a_case_with_readings_is_fitted(self, trench, run):
        assert next_steps(run("check", "case.yaml")) == ["geoident fit case.yaml"]
        planned = run("check", "case.yaml", "--identifiability")
        assert next_steps(planned) == ["geoident fit case.yaml"]

    @pytest.mark.usefixtures("plain_pictures")
    def test_after_figures_alone_no_page_is_opened(self, fitted_trench, run):
        (step,) = next_steps(run("report", "case.fit.h5", "--no-page", "--figures", "pictures"))
        assert step == "look at the figures in pictures"
        (step,) = next_steps(run("report", "case.fit.h5"))
        assert "page in a browser" in step

    def test_a_script_in_a_file_waits_for_a_new_shell(self, run, monkeypatch):
        (step,) = next_steps(run("completion", "fish"))
        assert step.startswith("open a new fish")
        monkeypatch.setattr("geoident.cli.commands.completion._looked_at", lambda: True)
        (step,) = next_steps(run("completion", "fish"))
        assert step == "geoident completion fish > ~/.config/fish/completions/geoident.fish"


class TestCheck:
    @pytest.mark.parametrize(
        ("method", "words"),
        [
            ("gauss-newton", "A fit by gauss-newton takes 5 to 10 evaluations."),
            ("complementarity", "A fit by complementarity takes 20 to 60 evaluations"),
            ("[scan, gauss-newton]", "A scan takes 121 evaluations without derivatives. A fit by"),
        ],
    )
    def test_it_names_the_method_that_a_fit_will_use(self, trench, run, method, words):
        tresca = "nu: 0.25, yield: {type: tresca, cohesion: $c}}"
        strength = "parameters:\n  c: {start: 5 MPa, bounds: [1, 9 MPa]}\n"
        text = CASE.replace("nu: 0.25}", tresca).replace("parameters:\n", strength)
        text = CASE if method.startswith("[") else text
        options = f"method: {method}, scan: {{points: 11}}"
        text = text.replace("method: gauss-newton", options).replace(", stages: [first]", "")
        (trench / "case.yaml").write_text(text)
        said = " ".join(run("check", "case.yaml").stdout.split())
        assert words in said
        if method == "gauss-newton":
            assert "complementarity" not in said

    def test_a_case_without_mesh_has_no_picture_and_nothing_else_is_said(self, tmp_path, run):
        run("init", tmp_path / "new", "--template", "opening")
        told = run("check", tmp_path / "new" / "case.yaml", "--picture", "a.svg")
        assert told.exit_code == 2
        assert told.stdout == ""
        assert "the case has no mesh, so nothing to draw" in told.stderr


def test_a_note_of_many_channels_is_one_line(trench, run):
    """The readings of 24 anchors before their zero, and those that are bad at one stage."""
    anchors = ", ".join(f"a{n}: [{1.0 + 0.02 * n:g} m, 3 m]" for n in range(24))
    text = CASE.replace("anchors: {a: [1 m, 3 m]}", f"anchors: {{{anchors}}}")
    (trench / "case.yaml").write_text(text.replace("stages: [first]", "stages: [first, second]"))
    rows = [row for row in READINGS.splitlines() if not row.startswith("X.a")]
    rows = [rows[0] + ",bad", *(f"{row}," for row in rows[1:])]
    rows += [f"X.a{n},first,0.06,mm,broken" for n in range(24)]
    (trench / "readings.csv").write_text("\n".join(rows) + "\n")
    said = " ".join(run("check", "case.yaml").stdout.partition("Notes")[2].split())
    assert said.count("X.a0") == 1
    assert "24 channels (X.a0, X.a1, X.a2, X.a3, X.a4, X.a5 and 18 more) at first are not" in said


def test_few_channels_are_all_named():
    assert named_channels(["CV", "EX.a5", "CV"]) == "CV, EX.a5"
