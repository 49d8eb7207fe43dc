"""What a model elsewhere really imports, reads and runs is part of it and never changes unseen."""

import json
import os
import py_compile
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from support.commands import run_command
from support.external import EXTERNAL, HEAD, PROGRAM, PYTHON, SCRIPT, trusted, write_case

from geoident.errors import ExitCode, InputError
from geoident.workflow.campaign.plan import plan_campaign
from geoident.workflow.running.jobs import build_model, load_inputs

FORMULA = "def values(E):\n    return [[E, 2.0 * E]] * 3\n"
"""Readings of three gauges at two stages, of a module beside the function."""

CALLS = """

def readings(given):
    return values(given["E"])
"""


@pytest.fixture(autouse=True)
def own_state(tmp_path, monkeypatch):
    """Decisions of these tests are not those of who runs them."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def case_of(tmp_path, first, *, files=""):
    """A case of a function that begins with some lines."""
    model = PYTHON.replace("}", f", files: [{files}]}}") if files else PYTHON
    return write_case(tmp_path / "case", model, script=first + CALLS)


def simulated(case, *options):
    return run_command("simulate", case, "--force", *options)


def first_reading(case, *options):
    """What the model gives for the first reading, mm."""
    done = simulated(case, *options, "-o", case.with_name("made.csv"))
    assert done.exit_code == 0, done.output
    lines = case.with_name("made.csv").read_text().splitlines()
    at = lines[0].split(",").index("value")
    return float(lines[1].split(",")[at])


@pytest.mark.parametrize(
    ("first", "place"),
    [
        ("from lib.physics import values", "lib/physics.py"),
        ("import lib.physics\nvalues = lib.physics.values", "lib/physics.py"),
        ("from importlib import import_module\nvalues = import_module('physics').values",
         "physics.py"),
        ("values = __import__('physics').values", "physics.py"),
        ("from lib.deep.a import values", "lib/deep/b.py"),
    ],
)  # fmt: skip
def test_what_is_imported_is_asked_for_again_when_it_changes(tmp_path, first, place):
    case = case_of(tmp_path, first)
    module = case.parent / place
    module.parent.mkdir(parents=True, exist_ok=True)
    (module.parent / "a.py").write_text("from .b import values\n")
    module.write_text(FORMULA)
    assert first_reading(case, "--trust") == pytest.approx(6e12)
    module.write_text(FORMULA.replace("[E,", "[3 * E,"))
    assert simulated(case).exit_code == ExitCode.INVALID_INPUT
    assert first_reading(case, "--trust") == pytest.approx(18e12)


@pytest.mark.parametrize(
    ("first", "place"),
    [
        ("from importlib import import_module\nvalues = import_module('phy' + 'sics').values",
         "physics.py"),
        ("exec(open(HERE + '/physics.py').read())", "physics.py"),
        ("exec(open(HERE + '/physics.txt').read())", "physics.txt"),
        ("import runpy\nvalues = runpy.run_path(HERE + '/physics.py')['values']", "physics.py"),
        ("import sys\nsys.path.append(HERE + '/../elsewhere')\nfrom physics import values",
         "../elsewhere/physics.py"),
        ("import numpy\ndef values(E): return [[E * numpy.memmap(HERE + '/one.bin')[0], E]] * 3",
         "one.bin"),
        ("import os\nos.system(HERE + '/run.sh')\ndef values(E): return [[E, E]] * 3", "run.sh"),
        ("import subprocess\nsubprocess.run(['sh', HERE + '/run.sh'])\n"
         "def values(E): return [[E, E]] * 3", "run.sh"),
        ("import subprocess\nsubprocess.run('./run.sh', cwd=HERE, shell=True)\n"
         "def values(E): return [[E, E]] * 3", "run.sh"),
        ("try:\n    exec(open(HERE + '/physics.py').read())\nexcept OSError:\n    values = 0",
         "physics.py"),
        ("import subprocess, sys\nsubprocess.run([sys.executable, HERE + '/physics.py'])\n"
         "def values(E): return [[E, E]] * 3", "physics.py"),
    ],
)  # fmt: skip
def test_what_the_case_does_not_name_is_not_run_until_it_is_listed(tmp_path, first, place):
    head = "import os\nHERE = os.path.dirname(os.path.abspath(__file__))\n"
    case = case_of(tmp_path, head + first)
    module = case.parent / place
    module.parent.mkdir(exist_ok=True)
    ran = tmp_path / "ran"
    text = {".sh": f"#!/bin/sh\ntouch '{ran}'\n", ".bin": "\1"}
    module.write_text(text.get(module.suffix, FORMULA + f"open({str(ran)!r}, 'w').close()\n"))
    module.chmod(0o755)
    refused = simulated(case, "--trust")
    shown = place if ".." not in place else str(tmp_path / "elsewhere" / "physics.py")
    assert f"reads '{shown}', which the case does not name" in refused.output
    assert "'files'" in refused.output
    assert refused.exit_code != 0
    assert "Traceback" not in refused.output
    assert not ran.exists()

    listed = case.read_text().replace('readings"}', f'readings", files: [{place}]}}')
    case.write_text(listed)
    assert first_reading(case, "--trust") == pytest.approx(6e12)
    assert ran.exists() or place == "one.bin"
    if module.suffix not in text and "subprocess" not in first:
        module.write_text(FORMULA.replace("[E,", "[3 * E,"))
        assert simulated(case).exit_code == ExitCode.INVALID_INPUT
        assert first_reading(case, "--trust") == pytest.approx(18e12)


def test_modules_in_an_archive_that_is_not_installed_are_refused(tmp_path):
    head = "import os, sys\nHERE = os.path.dirname(os.path.abspath(__file__))\n"
    case = case_of(
        tmp_path, head + "sys.path.insert(0, HERE + '/../a.zip')\nfrom physics import values"
    )
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("physics.py", FORMULA)
    refused = simulated(case, "--trust")
    assert f"reads '{tmp_path / 'a.zip'}', which the case does not name" in refused.output


def test_a_function_works_in_its_own_folder(tmp_path, monkeypatch):
    """Not in that of another case, which may have a file of the same name."""
    script = "def values(E): return [[E * float(open('factor.txt').read()), E]] * 3"
    case = case_of(tmp_path, script, files="factor.txt")
    (case.parent / "factor.txt").write_text("2.0")
    (tmp_path / "factor.txt").write_text("7.0")
    monkeypatch.chdir(tmp_path)
    assert first_reading(case, "--trust") == pytest.approx(12e12)


@pytest.mark.parametrize("made", [
    "type('Readings', (dict,), {'__module__': __name__})",
    "lambda rows: [Row(*row.values()) for row in rows.values()]",
])  # fmt: skip
def test_a_function_may_answer_with_classes_of_its_own(tmp_path, made):
    case = case_of(
        tmp_path,
        f"""
from collections import namedtuple
Row = namedtuple("Row", "half open")
Readings = {made}
def values(E): return Readings({{g: {{"half": E, "open": 2 * E}} for g in "HVD"}})
""",
    )
    assert first_reading(case, "--trust") == pytest.approx(6e12)


def test_a_function_in_a_pipe_is_refused_and_not_waited_for(tmp_path):
    case = case_of(tmp_path, FORMULA)
    (case.parent / "opening.py").unlink()
    os.mkfifo(case.parent / "opening.py")
    refused = run_command("check", case)
    assert refused.exit_code == ExitCode.INVALID_INPUT
    assert "opening.py" in refused.output


def test_an_object_that_only_the_function_knows_is_a_failed_run(tmp_path):
    case = case_of(tmp_path, "class Answer: pass\ndef values(E): return Answer()")
    failed = simulated(case, "--trust")
    assert "'readings' gave an object of a class that only its file has" in failed.output
    assert failed.exit_code == ExitCode.NO_SOLUTION


def test_a_table_that_a_function_reads_is_listed_and_what_it_writes_is_its_own(tmp_path):
    script = """
import os, pathlib
here = pathlib.Path(__file__).parent
def values(E):
    (here / "scratch.txt").write_text("1.0")
    (here / "case.runs" / "kept.txt").touch()
    (here / "case.runs" / "kept.txt").read_text()
    return [[E * float((here / name).read_text())] * 2 for name in ("factor.txt", "scratch.txt")
            for _ in range(2)][:3]
"""
    case = case_of(tmp_path, script)
    (case.parent / "factor.txt").write_text("2.0")
    refused = simulated(case, "--trust")
    assert "'readings' reads 'factor.txt', which the case does not name" in refused.output
    case = case_of(tmp_path, script, files="factor.txt")
    assert first_reading(case, "--trust") == pytest.approx(12e12)
    (case.parent / "factor.txt").write_text("3.0")
    assert first_reading(case, "--trust") == pytest.approx(18e12)


def test_nothing_compiled_that_lies_beside_a_case_is_run(tmp_path):
    case = case_of(tmp_path, "from physics import values")
    folder = case.parent
    planted = FORMULA.replace("[E,", "[99 * E,")
    for name, true in (("physics", FORMULA), ("opening", (folder / "opening.py").read_text())):
        (folder / f"{name}.py").write_text(planted + CALLS)
        py_compile.compile(
            str(folder / f"{name}.py"),
            invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH,
        )
        (folder / f"{name}.py").write_text(true)
    assert len(list((folder / "__pycache__").iterdir())) == 2
    assert first_reading(case, "--trust") == pytest.approx(6e12)


@pytest.mark.parametrize("kind", ["physics.pyc", "physics.so"])
def test_a_module_without_source_is_named(tmp_path, kind):
    case = case_of(tmp_path, "from physics import values")
    source = tmp_path / "source.py"
    source.write_text(FORMULA)
    py_compile.compile(str(source), cfile=str(case.parent / kind))
    refused = simulated(case, "--trust")
    assert f"reads '{kind}', which the case does not name" in refused.output


def test_a_module_named_as_one_that_a_library_imports_is_not_run(tmp_path):
    case = case_of(tmp_path, "import scipy.optimize\n" + FORMULA)
    ran = tmp_path / "ran"
    for name in ("heapq", "random", "scipy"):
        (case.parent / f"{name}.py").write_text(f"open({str(ran)!r}, 'w').close()\n")
    case.write_text(case.read_text())
    simulated(case)
    assert not ran.exists()  # not trusted
    (case.parent / "scipy.py").unlink()
    done = simulated(case, "--trust")
    assert not ran.exists()
    assert "Traceback" not in done.output


@pytest.mark.parametrize(
    ("command", "changed"),
    [
        ("PYTHON, -S, HERE/elsewhere/prog.py", "elsewhere/prog.py"),
        ("PYTHON, -S, HERE/elsewhere/prog.py", "elsewhere/ground.py"),
        ("PYTHON, -S, ../../prog.py", "case/prog.py"),
        ("sh, -c, 'cat opening.in>copy; PYTHON -S HERE/case/prog.py'", "case/prog.py"),
        ("./prog.py", "case/ground.py"),
        ("./prog", "case/ground.py"),
        ("HERE/elsewhere/prog.py", "elsewhere/ground.py"),
        ("env, A=1, PYTHON, -S, HERE/elsewhere/prog.py", "elsewhere/ground.py"),
        ("env, solver", "bin/ground.py"),
        ("PYTHON, -S, HERE/elsewhere", "elsewhere/ground.py"),
        ("""sh, -c, 'PYTHON -S "HERE/a b/prog.py" > HERE/log'""", "a b/ground.py"),
        ("sh, -c, 'P=HERE/elsewhere/prog.py; PYTHON -S $P'", "elsewhere/ground.py"),
        ("sh, -c, 'PYTHON -S $PLACE/prog.py'", "elsewhere/ground.py"),
        ("env, PYTHONPATH=HERE/elsewhere, PYTHON, -S, -m, prog", "elsewhere/ground.py"),
        ("sh, -c, 'D=$PWD; cp opening.in HERE/elsewhere; cd HERE/elsewhere && "
            "PYTHON -S prog.py && cp out.csv $D'",
         "elsewhere/prog.py"),
    ],
)  # fmt: skip
def test_a_program_among_the_arguments_is_part_of_the_model(
    tmp_path, monkeypatch, command, changed
):
    monkeypatch.setenv("PLACE", str(tmp_path / "elsewhere"))
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    command = command.replace("PYTHON,", f"{sys.executable},").replace(
        "PYTHON ", f"{sys.executable} "
    )
    command = command.replace("HERE", str(tmp_path))
    model = EXTERNAL.replace(f"{sys.executable}, -S, opening.py", command)
    case = write_case(tmp_path / "case", model.replace("  files: [opening.py]\n", ""))
    program = f"#!{sys.executable} -S\nfrom ground import NU\n" + PROGRAM.replace(
        "nu=0.25", "nu=NU"
    )
    for place in ("case", "elsewhere", "a b", "bin"):
        folder = tmp_path / place
        folder.mkdir(exist_ok=True)
        for name in ("prog.py", "prog", "solver", "__main__.py"):
            (folder / name).write_text(program)
            (folder / name).chmod(0o755)
        (folder / "ground.py").write_text("NU = 0.25\n")
    before = first_reading(case, "--trust")
    assert first_reading(case) == before
    file = tmp_path / changed
    number = "NU = 0.4" if file.name == "ground.py" else "NU = 0.4\n#"
    file.write_text(
        file.read_text().replace("from ground import NU", number).replace("NU = 0.25", number)
    )
    assert simulated(case).exit_code == ExitCode.INVALID_INPUT
    assert first_reading(case, "--trust") == pytest.approx(before * 1.12)


def test_another_name_of_a_file_is_another_model(tmp_path):
    program = PROGRAM.replace(
        "\nE, K =", "\nimport os\nif os.path.exists('dry.txt'): STAGES['half'] = 0.9\nE, K ="
    )
    model = EXTERNAL.replace("[opening.py]", "[opening.py, wet.txt]")
    case = write_case(tmp_path / "case", model, script=program)
    (case.parent / "wet.txt").touch()
    before = first_reading(case, "--trust")
    (case.parent / "wet.txt").rename(case.parent / "dry.txt")
    case.write_text(case.read_text().replace("wet.txt", "dry.txt"))
    assert simulated(case).exit_code == ExitCode.INVALID_INPUT
    assert first_reading(case, "--trust") == pytest.approx(1.8 * before)


def test_a_text_that_was_listed_is_no_module_because_it_is_called_so(tmp_path):
    first = "try:\n    from physics import values\nexcept ImportError:\n    "
    case = case_of(tmp_path, first + FORMULA.replace("\n", "\n    "), files="notes.txt")
    (case.parent / "notes.txt").write_text(FORMULA.replace("[E,", "[3 * E,"))
    assert first_reading(case, "--trust") == pytest.approx(6e12)
    (case.parent / "notes.txt").rename(case.parent / "physics.py")
    case.write_text(case.read_text().replace(", files: [notes.txt]", ""))
    assert simulated(case).exit_code == ExitCode.INVALID_INPUT


def test_another_program_of_the_same_name_is_asked_for(tmp_path, monkeypatch):
    for name, factor in (("one", 1.0), ("two", 3.0)):
        (tmp_path / name).mkdir()
        solver = tmp_path / name / "solver"
        solver.write_text(f"#!{sys.executable} -S\nexec(open('opening.py').read())\n# {factor}\n")
        solver.chmod(0o755)
    case = write_case(
        tmp_path / "case", EXTERNAL.replace(f"[{sys.executable}, -S, opening.py]", "[solver]")
    )
    path = os.environ["PATH"]
    monkeypatch.setenv("PATH", os.pathsep.join([str(tmp_path / "one"), path]))
    first_reading(case, "--trust")
    first = load_inputs(str(case))
    assert simulated(case).exit_code == 0
    (tmp_path / "one" / "solver").write_bytes((tmp_path / "two" / "solver").read_bytes())
    assert simulated(case).exit_code == ExitCode.INVALID_INPUT
    other = load_inputs(str(case))
    assert other.identity("fit", (), seed=0) != first.identity(
        "fit", (), seed=0
    )  # no search goes on
    assert other.mesh_sha256 == first.mesh_sha256  # a fit of another machine predicts


def test_what_is_installed_or_hidden_below_a_case_is_not_of_it(tmp_path):
    first = (
        """
import pathlib, sys
here = pathlib.Path(__file__).parent
(here / ".settings" / "look.txt").read_text()
(here / "case.yaml").exists()
"""
        + FORMULA
    )
    case = case_of(tmp_path, first)
    (case.parent / ".settings").mkdir()
    (case.parent / ".settings" / "look.txt").touch()
    assert first_reading(case, "--trust") == pytest.approx(6e12)
    kept = case.parent / "case.runs" / "left.py"
    kept.write_text(FORMULA)
    (case.parent / "opening.py").write_text(
        "exec(open(__file__.replace('opening.py', 'case.runs/left.py')).read())" + CALLS
    )
    refused = simulated(case, "--trust")  # the folder of runs may come with the case
    assert "reads 'case.runs/left.py', which the case does not name" in refused.output


def test_what_is_installed_where_it_lies_is_not_of_the_case(tmp_path, monkeypatch):
    """As ``pip install -e`` has it, by a finder and not by a folder on the path."""
    project, site = tmp_path / "my project", tmp_path / "site"
    said = site / "physics-1.dist-info" / "direct_url.json"
    said.parent.mkdir(parents=True)
    project.mkdir()
    (project / "ground.py").write_text(FORMULA)
    (site / "physics.py").write_text(
        "import importlib.util as u\n"
        f"spec = u.spec_from_file_location('ground', {str(project / 'ground.py')!r})\n"
        "ground = u.module_from_spec(spec)\nspec.loader.exec_module(ground)\nvalues = ground.values"
    )
    monkeypatch.syspath_prepend(site)
    case = case_of(tmp_path, "from physics import values")
    refused = simulated(case, "--trust")
    assert f"reads '{project / 'ground.py'}', which the case does not name" in refused.output
    told = {"url": project.as_uri(), "dir_info": {"editable": True}}
    said.write_text(json.dumps(told))
    shutil.rmtree(case.with_name("case.runs"))  # which keeps failed runs, too
    assert first_reading(case, "--trust") == pytest.approx(6e12)


def test_a_folder_of_modules_that_holds_the_case_is_not_installed(tmp_path):
    case = case_of(tmp_path, "values = __import__('phy' + 'sics').values")
    (case.parent / "physics.py").write_text(FORMULA)
    command = [sys.executable, "-m", "geoident", "simulate", "case.yaml", "--trust"]
    paths = {"PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])}
    done = subprocess.run(
        command,
        cwd=case.parent,
        env=os.environ | paths,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "reads 'physics.py', which the case does not name" in done.stderr
    assert done.returncode != 0


def test_a_campaign_computes_anew_where_the_program_is_another(tmp_path):
    solver = tmp_path / "solver"
    solver.write_text(f"#!{sys.executable} -S\nexec(open('opening.py').read())\n")
    solver.chmod(0o755)
    model = EXTERNAL.replace(f"[{sys.executable}, -S, opening.py]", f"[{solver}, --verbose]")
    write_case(tmp_path / "case", model)
    campaign = tmp_path / "case" / "campaign.yaml"
    campaign.write_text(
        "format: geoident-campaign/1\ncase: case.yaml\ncommand: simulate\n"
        "variations: {product: {parameters.K0.start: [1.0, 0.8]}}\n"
    )
    keys = [run.key for run in plan_campaign(str(campaign)).runs]
    assert [run.key for run in plan_campaign(str(campaign)).runs] == keys
    solver.write_text(solver.read_text() + "# another\n")
    assert not {run.key for run in plan_campaign(str(campaign)).runs} & set(keys)


def test_nothing_compiled_beside_a_program_is_run(tmp_path):
    folder = write_case(tmp_path / "case", EXTERNAL).parent
    program = (folder / "opening.py").read_text()
    (folder / "prog.py").write_text(
        program.replace("import math", "import math\nfrom ground import NU").replace(
            "nu=0.25", "nu=NU"
        )
    )
    ground = folder / "ground.py"
    ground.write_text("NU = 0.45\n")
    py_compile.compile(str(ground), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    ground.write_text("NU = 0.25\n")
    plain = first_reading(folder / "case.yaml", "--trust")
    model = EXTERNAL.replace("opening.py]\n  inputs", "../../prog.py]\n  inputs")
    (folder / "case.yaml").write_text(model + HEAD)
    assert first_reading(folder / "case.yaml", "--trust") == pytest.approx(plain)


@pytest.mark.parametrize(("model", "script"), [(EXTERNAL, PROGRAM), (PYTHON, SCRIPT)])
def test_a_model_that_changes_while_it_is_run_ends_the_command(tmp_path, model, script):
    case = write_case(tmp_path, model, script=script)
    built = build_model(load_inputs(str(case)))
    program = tmp_path / "opening.py"
    with trusted():
        built.computed(np.array([6e9, 1.0]))
        os.utime(program)  # as it was
        built.computed(np.array([7e9, 1.0]))
        program.write_text(script.replace("0.25", "0.45"))
        with pytest.raises(InputError, match="has changed since it was looked at") as caught:
            built.computed(np.array([8e9, 1.0]))
    [fault] = caught.value.faults
    assert Path(fault.location.file).name == "opening.py"
    assert fault.hint
    assert len((tmp_path / "case.runs" / "runs.jsonl").read_text().splitlines()) == 2
