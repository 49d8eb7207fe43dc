"""What errors propose, in the words of who calls: flags on a command line, arguments in Python."""

import ast
import re
from pathlib import Path

import pytest

import geoident
from geoident.errors import (
    Caller,
    Fault,
    InputError,
    Location,
    ModelError,
    OutputError,
    Term,
    worded,
)

PACKAGE = Path(geoident.__file__).parent
FLAG = re.compile(r"(?<![\w-])(--[a-z][a-z-]+|-[ojnqv])\b")
COMMAND_LINE = re.compile(r"[`']geoident [^`']*[`']|gmsh FILE .*|^ ?-o ?$")
"""What is no proposal to the caller: whole command lines, a line with dots of matplotlib."""
MADE_FOR_COMMANDS = {
    "errors.py",  # the terms themselves
    "io/docs",  # scripts of their own, and texts about commands
    "io/case/ladder.py",  # the page of keys speaks of commands
    "io/bridges/pest.py",  # command lines in files of other programs
    "io/bridges/dakota.py",
    "report/page",  # variables of CSS; its sentences come from elsewhere
}


def texts(text):
    """The texts of a module's text that are no docstrings."""
    tree = ast.parse(text)
    lone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in lone:
            yield node.lineno, node.value


def flags_of(text):
    """Flags in a text, those of whole command lines left out."""
    return FLAG.findall(COMMAND_LINE.sub("", text))


def test_flags_are_seen():
    assert flags_of("give a folder to -o, or --force it") == ["-o", "--force"]
    assert flags_of("a well-known +-2, 1-4 mm, 'geoident check --mesh-error'") == []


def test_no_message_below_the_command_line_names_a_flag():
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE).as_posix()
        whole = path.read_text(encoding="utf-8")
        if place.startswith(("cli/", *MADE_FOR_COMMANDS)) or not FLAG.search(whole):
            continue
        found += [f"{place}:{n}: {text}" for n, text in texts(whole) if flags_of(text)]
    assert "\n".join(found) == ""


@pytest.mark.parametrize(
    "error",
    [
        OutputError(f"a.h5: exists\n    {Term.FORCE} replaces it, {Term.OUTPUT} writes elsewhere"),
        InputError([Fault("x", "wrong", f"see {Term.FORCE}, {Term.OUTPUT}", Location("a"))]),
        ModelError("no solution", f"try {Term.FORCE} or {Term.OUTPUT}"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_speaks_to_who_calls(error):
    assert "--force" in str(error)
    assert "-o" in str(error)
    error.tell(Caller.PYTHON)
    assert "force=True" in str(error)
    assert "output=..." in str(error)
    assert "--force" not in str(error)


def test_places_and_single_faults_are_worded_too():
    error = InputError([Fault("x", "wrong", f"{Term.FIT}", Location(str(Term.OVERRIDES)))])
    assert str(error) == "--set: wrong\n    `geoident fit`"
    error.tell(Caller.PYTHON)
    (fault,) = error.faults
    assert str(error) == str(fault) == "overrides: wrong\n    `fit(case)`"
    assert fault.location.file == "overrides"


def test_brackets_of_others_stay():
    assert (
        worded("\u27e6NOT_A_TERM\u27e7 {force} <FORCE>") == "\u27e6NOT_A_TERM\u27e7 {force} <FORCE>"
    )
