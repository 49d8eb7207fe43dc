"""The tutorial of the twin tunnels: every command works, and says what the text quotes."""

import re
import shlex
from importlib.resources import files
from pathlib import Path

import pytest

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


@pytest.mark.usefixtures("plain_pictures")
@pytest.mark.parametrize("second", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_every_command_of_the_tutorial_says_what_is_quoted(tmp_path, monkeypatch, run, second):
    """With and without the second fit, of readings taken as independent, which takes half of it."""
    monkeypatch.chdir(tmp_path)
    quoted = 0
    for command, lines in blocks():
        if not second and "tunnels/independent.h5" in command:
            continue
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
    check_what_is_told(run, second)


def check_what_is_told(run, second):
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
    if second:
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


def test_the_commands_are_those_of_the_whole_way():
    names = [command[0] for command, _ in blocks()]
    assert names == [
        "init", "check", "check", "check", "fit", "show", "fit", "diff", "predict", "show",
        "report", "export",
    ]  # fmt: skip
