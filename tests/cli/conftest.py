import json
from pathlib import Path

import pytest

from tests.support.commands import run_command
from tests.support.trench import write_case


@pytest.fixture
def trench(tmp_path, monkeypatch) -> Path:
    """The folder of a case, which is the current one."""
    write_case(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run():
    return run_command


@pytest.fixture
def run_json(run):
    """The JSON objects that a command prints, one a line, without NaN."""

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    def objects(*arguments):
        found = run(*arguments, "--json")
        return [json.loads(line, parse_constant=refuse) for line in found.stdout.splitlines()]

    return objects
