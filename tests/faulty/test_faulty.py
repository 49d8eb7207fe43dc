"""Faulty cases, one a folder: what is said of them, word by word, with the exit code.

``expected.txt`` holds the command, what it says and its exit code. After a change of a message, see
what has become of it: GEOIDENT_WRITE_EXPECTED=1 pytest tests/faulty; git diff tests/faulty
"""

import ctypes
import json
import multiprocessing
import os
import re
import shlex
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from tests.support.commands import run_command

FOLDER = Path(__file__).parent
CASES = sorted(path.name for path in FOLDER.glob("[0-9][0-9]-*"))
PLACED = re.compile(
    r"(?:[^\s:]+:\d+:\d+|--set|[^\s:]+:[^!:]+![A-Z]+\d+|"
    r"[^\s:]+\.(?:h5|yaml|ags|xlsx?)(?::[^!:]+)?): "
)
CAPABILITIES_3, CAP_DAC_OVERRIDE = 0x20080522, 1  # of linux/capability.h
FILE_SIZE = 3000  # bytes, less than a result has


def forget_that_root_may_write_anywhere():
    if os.geteuid() == 0:
        libc = ctypes.CDLL(None)
        of_this = (ctypes.c_uint32 * 2)(CAPABILITIES_3, 0)
        sets = (ctypes.c_uint32 * 6)()  # effective, permitted, inheritable, and the upper bits
        assert libc.capget(of_this, sets) == 0
        sets[0] &= ~(1 << CAP_DAC_OVERRIDE)
        assert libc.capset(of_this, sets) == 0


def limit_files():
    import resource  # noqa: PLC0415 - POSIX only

    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_SIZE, FILE_SIZE))


LIMITS = {
    "32-read-only-folder": forget_that_root_may_write_anywhere,
    "33-file-size-limit": limit_files,
}


@pytest.fixture
def full_disk():
    """A file system of a few pages; only root may make one."""
    mounted = []

    def mount(folder):
        folder.mkdir()
        made = shutil.which("mount") and subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", folder], check=False,
            capture_output=True,
        )  # fmt: skip
        if not made or made.returncode:
            pytest.skip("a small file system cannot be made here")
        mounted.append(folder)

    yield mount
    for folder in mounted:
        subprocess.run(["umount", folder], check=True)


@pytest.fixture
def case(request, tmp_path, monkeypatch, full_disk):
    """The folder of a case, a copy, which is the current one."""
    name = request.param
    if name == "76-ags-rows":
        pytest.importorskip("python_ags4", reason="needs pip install --no-deps python-ags4")
    shutil.copytree(FOLDER / "shared", tmp_path / "shared")
    here = tmp_path / name
    shutil.copytree(FOLDER / name, here)
    if name == "32-read-only-folder":
        (here / "read-only").mkdir(mode=0o555)
    if name == "34-full-disk":
        full_disk(here / "full")
    monkeypatch.chdir(here)
    return here


def run_here(name, words):
    """Exit code, stdout and stderr of a command."""
    if name not in LIMITS:
        told = run_command(*words)
        return told.exit_code, told.stdout, told.stderr
    if sys.platform != "linux":
        pytest.skip("needs limits of Linux, and a fork")
    limit = LIMITS[name]

    here, there = multiprocessing.Pipe(duplex=False)

    def limited():
        limit()
        told = run_command(*words)
        there.send((told.exit_code, told.stdout, told.stderr))

    # A process of its own, for what is taken away does not come back.
    process = multiprocessing.get_context("fork").Process(target=limited)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads of linear algebra
        process.start()
    there.close()
    said = here.recv()
    process.join()
    return said


def files(folder):
    return {
        path.relative_to(folder): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".checkpoint"
    }


@pytest.mark.parametrize("case", CASES, indirect=True)
def test_what_is_said(case):
    expected = (case / "expected.txt").read_text(encoding="utf-8")
    command = expected.partition("\n")[0]
    words = shlex.split(command.removeprefix("$ geoident"))
    before = files(case)
    code, stdout, stderr = run_here(case.name, words)
    said = f"{command}\n{stderr}exit {code}\n"
    if os.environ.get("GEOIDENT_WRITE_EXPECTED"):
        (FOLDER / case.name / "expected.txt").write_text(said, encoding="utf-8")
    assert said == expected
    assert stdout == ""
    assert files(case) == before


@pytest.mark.parametrize("name", CASES)
def test_every_message_has_a_place_and_a_remedy(name):
    _, *lines, code = (FOLDER / name / "expected.txt").read_text(encoding="utf-8").splitlines()
    assert code.removeprefix("exit ") in {"3", "5", "6"}
    if re.fullmatch(r"\d+ faults", lines[-1]):
        lines.pop()
    assert len(lines) % 2 == 0
    for message, remedy in zip(lines[::2], lines[1::2], strict=True):
        assert PLACED.match(message.removeprefix("error: "))
        assert re.match(r" {4}\S", remedy)


def test_json_has_the_same_place_and_remedy(tmp_path):
    for name in ("08-parameters", "20-no-supports"):
        shutil.copytree(FOLDER / name, tmp_path / name)
        shutil.copytree(FOLDER / "shared", tmp_path / "shared", dirs_exist_ok=True)
        told = json.loads(run_command("check", tmp_path / name / "case.yaml", "--json").stdout)
        said = (FOLDER / name / "expected.txt").read_text(encoding="utf-8")
        assert told["faults"]
        for fault in told["faults"]:
            place = f"case.yaml:{fault['line']}:{fault['column']}: {fault['path']}: "
            assert f"{place}{fault['message']}\n    {fault['hint']}\n" in said


def test_there_are_enough():
    assert len(CASES) >= 20
