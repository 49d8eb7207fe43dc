"""Through which files of the package a datum passes on its way to what is made of it.

Run: python tests/benchmarks/paths.py [E_rock] [reading] [plane]

    E_rock    start and name of a modulus, to its column of the Jacobian (cases/cavern)
    reading   the value of one reading, to the weighted residuals (cases/cavern)
    plane     normal and name of a yield plane, to the certificate (the trench of tests/support)

A datum is computed with twice, each time in a process of its own, in two cases that differ in it
alone. A file counts if an argument or a result of one of its functions differs: texts, numbers,
arrays, dual numbers, and records of them, one level deep. So files that only hash, check or show it
count, too, and all that is computed with it; which of them are on the way, and what they do there,
is in ARCHITECTURE.md.

Of a plane it also prints which files make, read or change one of its forms (`FORMS`), whatever the
numbers: those that know planes. Files that only hold what holds a form are not among them.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
PACKAGE = f"{ROOT}/geoident/"
sys.path.insert(0, str(ROOT / "tests"))

from support.trench import CASE, write_case  # noqa: E402

from geoident.fem.yielding.planes import ReturnStep, ScaledPlanes, YieldPlanes  # noqa: E402
from geoident.identify import identify  # noqa: E402
from geoident.identify.problem.problem import Discrepancy, Problem  # noqa: E402
from geoident.model.yielding import (  # noqa: E402
    Activity,
    Certificate,
    GivenPlanes,
    YieldPlane,
)
from geoident.report.text.gauges import readings_csv  # noqa: E402
from geoident.workflow.estimating.setup import prepare, used_response  # noqa: E402
from geoident.workflow.running.jobs import Request, plan_fit  # noqa: E402
from geoident.workflow.running.readings import problem_of_readings  # noqa: E402
from geoident.workflow.simulate import simulate  # noqa: E402

_LARGE = 2_000_000
"""Entries of an array that is not looked at."""

Seen = dict[tuple[str, str], Counter[str]]
"""File and function to what went through it, and how often."""


def digest(x: Any, depth: int) -> str:
    """What tells values of one kind apart, records as deep as wanted."""
    kind = type(x).__name__
    if x is None or isinstance(x, bool | int | float | complex | str | bytes | np.generic):
        return repr(x)
    if isinstance(x, np.ndarray):
        small = x.dtype != object and x.size <= _LARGE
        return hashlib.blake2b(x.tobytes(), digest_size=8).hexdigest() if small else ""
    if depth <= 0:
        return kind
    if type(x) in (list, tuple):
        parts = [digest(y, depth - 1) for y in x[:200]]
    elif isinstance(x, dict):
        parts = [f"{digest(k, 0)}:{digest(v, depth - 1)}" for k, v in list(x.items())[:200]]
    elif dataclasses.is_dataclass(x) and not isinstance(x, type):
        parts = [digest(getattr(x, f.name, None), depth - 1) for f in dataclasses.fields(x)]
    elif hasattr(x, "model_fields_set"):
        parts = [digest(v, depth - 1) for v in x.__dict__.values()]
    else:
        return kind + (digest(x.columns, 1) if hasattr(x, "columns") else "")
    return f"{kind}({','.join(parts)})"


def watched(job: Callable[[], object]) -> Seen:
    """What goes through the functions of the package while a job is done."""
    seen: Seen = defaultdict(Counter)

    def watch(frame: FrameType, event: str, result: Any) -> None:
        code = frame.f_code
        if event not in ("call", "return") or not code.co_filename.startswith(PACKAGE):
            return
        if event == "call":
            names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
            said = [digest(frame.f_locals.get(name), 1) for name in names if name != "cls"]
        else:
            said = ["result", digest(result, 1)]
        key = hashlib.blake2b(repr(said).encode(), digest_size=8).hexdigest()
        seen[code.co_filename.removeprefix(PACKAGE), code.co_qualname][key] += 1

    sys.setprofile(watch)
    try:
        job()
    finally:
        sys.setprofile(None)
    return dict(seen)


def known(forms: Sequence[type], job: Callable[[], object]) -> Seen:
    """Which functions of the package make, read or change records while a job is done."""
    seen: Seen = defaultdict(Counter)

    def note(form: type) -> None:
        frame: FrameType | None = sys._getframe(2)
        while frame is not None and not frame.f_code.co_filename.startswith(PACKAGE):
            frame = frame.f_back
        if frame is not None:
            code = frame.f_code
            place = code.co_filename.removeprefix(PACKAGE), code.co_qualname
            seen[place][form.__name__] += 1

    def watch(form: Any) -> None:
        made, read = form.__init__, form.__getattribute__

        def make(self: Any, *args: Any, **kwargs: Any) -> None:
            note(form)
            made(self, *args, **kwargs)

        def get(self: Any, name: str) -> Any:
            if not name.startswith("__"):
                note(form)
            return read(self, name)

        form.__init__, form.__getattribute__ = make, get

    for form in forms:
        watch(form)
    job()
    return dict(seen)


def jacobian() -> None:
    setup = prepare(plan_fit(Request("case.yaml", output="x.h5", force=True)))
    response = used_response(setup)
    response.by_tangents(np.array([q.start for q in setup.case.parameters]))  # type: ignore[attr-defined]


def problem(request: Request) -> Problem:
    setup = prepare(plan_fit(request))
    return problem_of_readings(setup.case, setup.readings, used_response(setup))


def residuals() -> None:
    Discrepancy(problem(Request("case.yaml", output="x.h5", force=True)))


def certificate() -> None:
    request = Request("case.yaml", output="x.h5", force=True)
    identify(problem(request), plan_fit(request).methods, lambda iteration: None)


def cavern(folder: Path, file: str, *changes: tuple[str, str]) -> None:
    shutil.copytree(ROOT / "cases/cavern", folder, dirs_exist_ok=True)
    text = (folder / file).read_text()
    for one, other in changes:
        assert one in text, f"{file} has no '{one}'"
        text = text.replace(one, other)
    (folder / file).write_text(text)


def trench(folder: Path, normal: str, name: str) -> None:
    write_case(folder)
    text = CASE.replace(
        "  E:  {start: 2 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}\n"
        "  K0: {start: 1.0, bounds: [0.2, 4]}\n",
        "  k1: {start: 0.9 MPa, bounds: [0.1 MPa, 5 MPa], scale: log}\n",
    )
    plane = f"{{name: {name}, normal: {normal}, distance: $k1}}"
    planes = f"E: 5 GPa, nu: 0.25, yield: {{type: planes, planes: [{plane}]}}"
    text = text.replace("E: $E, nu: 0.25", planes).replace("K0: $K0", "K0: 1.5")
    text = text.replace("method: gauss-newton, stages: [first], ", "")
    case = folder / "case.yaml"
    case.write_text(text)
    exact = simulate(str(case), overrides=["parameters.k1.start=0.5 MPa"])
    (folder / "readings.csv").write_text(readings_csv(exact.readings, exact.case.channels))


Write = Callable[[Path], None]
PATHS: dict[str, tuple[Callable[[], None], Write, Write]] = {
    "E_rock": (
        jacobian,
        lambda folder: cavern(folder, "case.yaml"),
        lambda folder: cavern(
            folder, "case.yaml", ("E_rock", "E_rack"), ("start: 20 GPa", "start: 20.5 GPa")
        ),
    ),
    "reading": (
        residuals,
        lambda folder: cavern(folder, "case.yaml"),
        lambda folder: cavern(
            folder, "readings.csv", ("EX-C.a20,heading,2.72,", "EX-C.a20,heading,2.71,")
        ),
    ),
    "plane": (
        certificate,
        lambda folder: trench(folder, "[0.7071067811865476, -0.7071067811865476, 0]", "shear"),
        lambda folder: trench(folder, "[0.7, -0.714142842854285, 0]", "slip"),
    ),
}
"""Datum to what is made of it, and the two cases."""

FORMS: dict[str, tuple[type, ...]] = {
    "plane": (GivenPlanes, YieldPlane, YieldPlanes, ScaledPlanes, ReturnStep, Activity, Certificate)
}
"""Datum to the records in which it goes."""


def passed(name: str, folder: Path) -> dict[str, list[str]]:
    """File to its functions through which a datum passed."""
    found: list[Seen] = []
    for case, write in zip(("one", "other"), PATHS[name][1:], strict=True):
        place = folder / name / case
        place.mkdir(parents=True)
        write(place)
        subprocess.run([sys.executable, __file__, "--watch", name], cwd=place, check=True)
        found.append(pickle.loads((place / "seen").read_bytes()))
    one, other = found
    files: dict[str, list[str]] = defaultdict(list)
    for key in sorted({*one, *other}):
        if one.get(key) != other.get(key):
            files[key[0]].append(key[1])
    return files


def knowing(name: str, folder: Path) -> dict[str, list[str]]:
    """File to the forms of a datum that it knows."""
    place = folder / name / "forms"
    place.mkdir(parents=True)
    PATHS[name][1](place)
    subprocess.run([sys.executable, __file__, "--forms", name], cwd=place, check=True)
    forms: dict[str, list[str]] = defaultdict(list)
    for (file, _), seen in sorted(pickle.loads((place / "seen").read_bytes()).items()):
        forms[file] += [form for form in seen if form not in forms[file]]
    return forms


def main(arguments: list[str]) -> None:
    if arguments[:1] == ["--watch"]:
        Path("seen").write_bytes(pickle.dumps(watched(PATHS[arguments[1]][0])))
        return
    if arguments[:1] == ["--forms"]:
        name = arguments[1]
        Path("seen").write_bytes(pickle.dumps(known(FORMS[name], PATHS[name][0])))
        return
    os.environ["PYTHONPATH"] = str(ROOT)
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments or PATHS:
            files = passed(name, Path(folder))
            print(f"{name}: {len(files)} files")
            for file, functions in files.items():
                print(f"  {file}: {' '.join(functions)}")
            if name in FORMS:
                forms = knowing(name, Path(folder))
                print(f"{name}: {len(forms)} files know its forms")
                for file, seen in forms.items():
                    print(f"  {file}: {' '.join(seen)}")


if __name__ == "__main__":
    main(sys.argv[1:])
