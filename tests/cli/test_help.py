"""Whoever asks is told: help with examples, what comes next, completion, documentation."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

from geoident.cli.app import COMMANDS, geoident
from geoident.cli.commands.completion import SHELLS
from geoident.cli.options import takes
from geoident.io.docs.templates import TEMPLATES

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "geoident" / "docs" / "commands.md"


@pytest.mark.parametrize("name", COMMANDS)
class TestEveryCommand:
    def test_it_has_help_with_examples_and_every_option_explained(self, run, name):
        told = run(name, "--help")
        assert told.exit_code == 0
        assert f"geoident {name}" in told.stdout.split("Examples")[1]
        command = geoident.get_command(None, name)
        options = [p for p in command.params if isinstance(p, click.Option)]
        assert [option.name for option in options if not option.help] == []

    def test_its_examples_have_flags_that_exist(self, run, name):
        command = geoident.get_command(None, name)
        known = {flag for parameter in command.params for flag in parameter.opts} | {"-h", "--help"}
        lines = re.findall(rf"geoident {name}\b((?:\"[^\"]*\"|[^|>&\n])*)", command.epilog)
        assert lines
        words = [word for line in lines for word in shlex.split(line, comments=True)]
        flags = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        assert flags <= known

    def test_it_is_documented(self, name):
        assert f"geoident {name}" in PAGE.read_text(encoding="utf-8")


def test_every_template_stands_apart_from_what_it_is(run):
    words = run("init", "--help").stdout.split("Templates:")[1].split()
    assert set(TEMPLATES) <= set(words)


class TestNext:
    def test_no_command_can_forget_it(self):
        with pytest.raises(TypeError, match="after"):
            takes()

    def test_after_a_fit_one_looks_at_it_and_predicts(self, trench, run):
        told = run("fit", "case.yaml")
        assert told.stdout == "case.fit.h5\n"
        after = told.stderr.split("Next:\n")[1].split("\n")
        assert [line.strip() for line in after if line] == [
            "geoident show case.fit.h5",
            "geoident report case.fit.h5",
            "geoident predict case.fit.h5",
        ]

    def test_simulated_readings_can_be_fitted_as_it_says(self, trench, run):
        (trench / "out").mkdir()
        told = run("simulate", "case.yaml", "-o", "out/r.csv")
        (step,) = told.stderr.split("Next:\n")[1].strip().splitlines()
        assert run(*shlex.split(step)[1:]).exit_code == 0

    def test_what_was_drawn_is_drawn_again_as_it_says(self, trench, run):
        told = run("simulate", "case.yaml", "--noise", "--seed", "3")
        (step,) = told.stderr.split("Next:\n")[1].strip().splitlines()
        assert run(*shlex.split(step)[1:]).exit_code == 0
        assert (trench / "simulated.csv").read_text().startswith(told.stdout)
        field = "materials.rock.E={field: {mean: $E, sd: 30 %, length: 3 m, modes: 3}}"
        told = run("simulate", "case.yaml", "--set", field, "--draw", "--seed", "3")
        assert "--draw --seed 3 -o" in told.stderr

    def test_changes_are_kept(self, trench, run):
        told = run("check", "case.yaml", "--set", "parameters.E.start=3 GPa")
        (step,) = told.stderr.split("Next:\n")[1].strip().splitlines()
        assert shlex.split(step)[1:] == ["fit", "case.yaml", "--set", "parameters.E.start=3 GPa"]

    @pytest.mark.parametrize("flag", ["-q", "--json"])
    def test_it_is_not_said_to_programs(self, trench, run, flag):
        assert "Next:" not in run("check", "case.yaml", flag).output

    def test_it_is_not_said_after_errors(self, trench, run):
        assert "Next:" not in run("check", "nothing.yaml").output


class TestCompletion:
    @pytest.mark.parametrize("shell", SHELLS)
    def test_the_script_is_for_the_shell(self, run, shell):
        told = run("completion", shell)
        assert told.exit_code == 0
        assert f"{shell}_complete" in told.stdout
        assert "_GEOIDENT_COMPLETE" in told.stdout
        if shutil.which(shell):
            assert subprocess.run([shell, "-n", "-c", told.stdout], check=False).returncode == 0

    @pytest.mark.parametrize(
        ("words", "expected"),
        [
            ("geoident pre", "plain,predict"),
            ("geoident fit --so", "plain,--solver"),
            ("geoident fit --solver ch", "plain,cholmod"),
            ("geoident fit ca", "file,ca"),
            ("geoident init --template d", "plain,dam"),
        ],
    )
    def test_words_are_completed(self, words, expected):
        environment = {
            **os.environ,
            "_GEOIDENT_COMPLETE": "bash_complete",
            "COMP_WORDS": words,
            "COMP_CWORD": str(len(words.split()) - 1),
        }
        command = [sys.executable, "-c", "from geoident.cli import main; main()"]
        told = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert told.returncode == 0, told.stderr
        assert expected in told.stdout.splitlines()
