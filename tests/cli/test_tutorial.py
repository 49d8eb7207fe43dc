"""The tutorial of the twin tunnels: every command works, and says what the text quotes."""

import re
import shlex
from importlib.resources import files
from pathlib import Path

import click
import pytest

from geoident.cli.app import geoident

TEXT = (files("geoident") / "templates" / "twin-tunnels" / "TUTORIAL.md").read_text("utf-8")
DIFFERENT = 1  # of diff
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def blocks():
    """Commands, each with the lines that the text quotes after it."""
    found = []
    for line in TEXT.splitlines():
        if line.startswith("    geoident "):
            found.append((shlex.split(line)[1:], []))
        elif line.startswith("    ") and not line.startswith("    name "):
            found[-1][1].append(line.split())
    return found


def numbers(words):
    return [float(word) for word in words if NUMBER.fullmatch(word)]


@pytest.mark.slow
@pytest.mark.usefixtures("plain_pictures")
def test_every_command_of_the_tutorial_says_what_is_quoted(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    quoted = 0
    for command, lines in blocks():
        done = run(*command)
        assert done.exit_code == (DIFFERENT if command[0] == "diff" else 0), done.output
        if command[0] == "init":
            assert done.stdout.splitlines()[0] == "tunnels/case.yaml"
            assert all(Path(file).exists() for file in done.stdout.splitlines())
            assert "geoident fit tunnels/case.yaml" in done.stderr
        said = {}
        for words in filter(None, map(str.split, done.output.splitlines())):
            said.setdefault(words[0], words)
        for words in lines:
            expected = numbers(words)
            found = numbers(said[words[0]])[: len(expected)]
            assert found == pytest.approx(expected, rel=0.02), (command, words)
            quoted += 1
    assert quoted == 9
    assert (tmp_path / "tunnels" / "case.fit.html").exists()
    check_what_is_told(run)


def check_what_is_told(run):
    """What the text says in words, of results that stand by now."""
    shown = run("show", "tunnels/case.predict.h5").output
    (street,) = (line.split() for line in shown.splitlines() if re.match(r"S\.P8 +B lined", line))
    assert numbers(street)[:3] == pytest.approx([5.9, 4.3, 7.4], abs=0.06)

    fitted = run("show", "tunnels/case.fit.h5").output
    assert "readings inside" in " ".join(fitted.split())
    axial, moment = zip(*map(lining_of_a(fitted).get, ("A lined", "B lined")), strict=True)
    assert axial[1] == pytest.approx(axial[0], rel=0.03)
    assert moment[1] == pytest.approx(2.1 * moment[0], rel=0.05)

    assert part_inside(shown) > 0.92
    other = run("show", "tunnels/independent.h5").output
    assert part_inside(other) < part_inside(shown)


def lining_of_a(text):
    """Stage to the largest axial force and moment of the lining of tunnel A."""
    rows = re.findall(r"lining-a +([AB] \w+) +(-[\d.]+) +-[\d.]+ +([\d.]+)", text)
    return {stage: (float(axial), float(moment)) for stage, axial, moment in rows}


def part_inside(text):
    """Part of the readings of predicted stages that lie in their bands."""
    counts = re.findall(r"(\d+) of (\d+) readings inside", text)
    return sum(int(a) for a, _ in counts) / sum(int(b) for _, b in counts)


def test_commands_of_the_tutorial_may_be_typed(tmp_path, monkeypatch, run):
    """What can be told of them without a fit: words, flags, and that their cases are valid."""
    monkeypatch.chdir(tmp_path)
    assert run(*blocks()[0][0]).exit_code == 0
    for (name, *words), _ in blocks()[1:]:
        command = geoident.get_command(click.Context(geoident), name)
        for file in [w for w in words if w.startswith("tunnels/") and w.endswith(".h5")]:
            Path(file).touch()
        asked = command.make_context(name, list(words)).params
        if asked.get("overrides"):
            sets = [w for given in asked["overrides"] for w in ("--set", given)]
            assert run("check", "tunnels/case.yaml", "-q", *sets).exit_code == 0


def test_the_commands_are_those_of_the_whole_way():
    names = [command[0] for command, _ in blocks()]
    assert names == [
        "init", "check", "check", "check", "fit", "show", "fit", "diff", "predict", "show",
        "report", "export",
    ]  # fmt: skip
