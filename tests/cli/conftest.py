import json
import shutil
from pathlib import Path

import pytest

from tests.support.commands import run_command
from tests.support.in_this_process import stay_in_this_process
from tests.support.trench import write_case


@pytest.fixture
def trench(tmp_path, monkeypatch) -> Path:
    """The folder of a case, which is the current one."""
    write_case(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def folders(tmp_path_factory):
    """Folders in which commands have run, each made once."""
    made: dict[object, Path] = {}

    def folder(write, commands) -> Path:
        key = write, commands
        if key not in made:
            place = tmp_path_factory.mktemp("made")
            write(place)
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(place)
                for words in commands:
                    done = run_command(*words)
                    assert done.exit_code in (0, 4), done.output
            made[key] = place
        return made[key]

    return folder


@pytest.fixture
def after(tmp_path, monkeypatch, folders):
    """Makes the current folder a copy of one in which commands have run.

    What many tests begin with is computed once: commands (tuples of words) run on what a function
    writes into a folder, the trench if none is given.
    """

    def copied(*commands, write=write_case) -> Path:
        shutil.copytree(folders(write, commands), tmp_path, dirs_exist_ok=True)
        monkeypatch.chdir(tmp_path)
        return tmp_path

    return copied


@pytest.fixture
def fitted_trench(after) -> Path:
    """The trench with its fit in the current folder, which several tests begin with."""
    return after(("fit", "case.yaml"))


@pytest.fixture
def in_this_process(monkeypatch):
    """Commands start no workers."""
    stay_in_this_process(monkeypatch)


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
