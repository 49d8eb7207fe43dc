"""How fast geoident is, beside its peers: one table, each row by itself.

    python tests/benchmarks/peers.py                            # all rows, hours
    python tests/benchmarks/peers.py --rows tunnel-3d cube-150k
    python tests/benchmarks/peers.py --rows check-1000k --folder cubes --json measured.json
    python tests/benchmarks/peers.py --recorded measured.json   # the table again, nothing is run

What is compared runs on the same mesh and machine, one after the other; read the ratios. Times
are by the clock, in brackets those of the processors. Needs gmsh, and for the peers Debian's
calculix-ccx. A fit that needs more memory than is free is left out, and says so.

    tunnel-3d        whole fit of cases/tunnel-3d / one CalculiX solve of its first stage
    cube-30k ...     whole fit of the cube with a cavern (`cube.py`) / one CalculiX step, conjugate
                     gradients with incomplete Cholesky, and / virgin state and removal by SPOOLES
    scripted         the fit of the small cube by scipy and CalculiX (`scripted_loop.py`) / geoident
    growth           exponent of the time of a fit of the cubes that were measured
    check-1000k      `geoident check` of the cube of a million unknowns
    cavern-plastic   factorizations of a fit of cases/cavern-plastic
    report           `geoident report` of the shipped cases
    reduced          100,000 evaluations of the reduced model of cases/tunnel-3d / its fit
"""

from __future__ import annotations

import argparse
import atexit
import json
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import date
from functools import lru_cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from support import calculix
from support.versions import versions

ROOT = Path(__file__).resolve().parents[2]
SIZES = {"30k": 30_000, "150k": 150_000, "400k": 400_000, "1000k": 1_040_000}
SHIPPED = (
    "braced-pit", "cavern", "cavern-field", "cavern-plastic", "dam", "gravity-dam",
    "pressure-tunnel", "shaft", "stratified-tunnel", "tunnel-3d",
)  # fmt: skip

FIT_BYTES = {"30k": 0.6e9, "150k": 3.0e9, "400k": 7.0e9, "1000k": 14.0e9}
"""Free memory without which a fit of a cube is not begun."""

REMOVAL = ("30k", "150k")
"""Cubes on which SPOOLES is asked too: it takes hours and all memory on larger ones."""


@dataclass(frozen=True)
class Cost:
    """What a command took.

    Args:
        seconds: by the clock.
        cpu: seconds of all its threads and processes.
        peak: largest memory, bytes.
        counts: what it counted itself.
    """

    seconds: float
    cpu: float
    peak: float
    counts: Mapping[str, float] = field(default_factory=dict)


Measured = dict[str, Cost]
"""What was measured in a row, by name; a row that was left out has none."""


@dataclass(frozen=True)
class Line:
    """A line of the table."""

    what: str
    ours: str
    peer: str
    ratio: str
    target: str


def measure(command: Sequence[object], **options: object) -> tuple[Cost, str]:
    """Run a command; what it took, and what it printed.

    Raises:
        CalledProcessError: it failed.
    """
    words, start = [str(word) for word in command], time.perf_counter()
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, **options) as process:
        assert process.stdout is not None
        printed = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 4):  # 4: finished, and says what is not determined
        raise subprocess.CalledProcessError(process.returncode, words)
    kilobytes = used.ru_maxrss
    cpu = used.ru_utime + used.ru_stime
    return Cost(time.perf_counter() - start, cpu, 1024.0 * kilobytes), printed


def program(*words: object) -> tuple[Cost, str]:
    """Run geoident as it is where it is installed: its modules were compiled once before."""
    environment = {**os.environ, "PYTHONPATH": str(_installed())}
    command = [sys.executable, "-P", "-m", "geoident", *words]
    return measure(command, stderr=subprocess.DEVNULL, env=environment)


@lru_cache(maxsize=1)
def _installed() -> Path:
    """A folder with the package and what Python makes of its modules before it runs them."""
    folder = Path(tempfile.mkdtemp(prefix="geoident-peers-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    shutil.copytree(ROOT / "geoident", folder / "geoident")
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}  # empty: they are written
    command = [sys.executable, "-m", "compileall", "-q", str(folder)]
    subprocess.run(command, env=environment, check=True)
    return folder


def fit(case: Path, result: Path) -> Cost:
    """A whole fit with its prediction, its errors and what it writes."""
    cost, printed = program("fit", "--fresh", "--force", "--json", case, "-o", result)
    return Cost(cost.seconds, cost.cpu, cost.peak, counts_of(printed))


def counts_of(printed: str) -> dict[str, float]:
    """The counts in what ``geoident fit --json`` prints.

    >>> counts_of('[{"case": "a", "counts": {"evaluations": 6, "factorizations": 7}}]')
    {'evaluations': 6.0, 'factorizations': 7.0}
    """
    found = json.loads(printed)
    one = found[0] if isinstance(found, list) else found
    return {name: float(count) for name, count in one["counts"].items()}


def peer(case: Path, folder: Path, name: str, words: str) -> Cost:
    """One run of CalculiX on the first stage of a case; its input is written before.

    Args:
        case: the case.
        folder: for its files.
        name: of its input.
        words: arguments of `calculix.write_first_stage`, by name, as JSON.
    """
    path = folder / f"{name}.inp"
    write = (
        "import json, sys; sys.path.insert(0, sys.argv[1]); from pathlib import Path\n"
        "from support import calculix\n"
        "calculix.write_file(sys.argv[2], Path(sys.argv[3]), **json.loads(sys.argv[4]))"
    )
    subprocess.run(
        [sys.executable, "-c", write, ROOT / "tests", case, path, words], check=True, cwd=ROOT
    )
    if calculix.PROGRAM is None:
        raise FileNotFoundError(calculix.REMEDY)
    environment = {**os.environ, "OMP_NUM_THREADS": str(os.cpu_count() or 1)}
    cost, _ = measure([calculix.PROGRAM, "-i", path.stem], cwd=folder, env=environment)
    for file in folder.glob(f"{name}.*"):
        file.unlink()
    return cost


def cube(size: str, folder: Path) -> Path:
    """The case of a cube, made once."""
    made = folder / f"cube-{size}" / "case.yaml"
    if not (made.parent / "readings.csv").exists():
        words = [sys.executable, ROOT / "tests/benchmarks/cube.py", "--dofs", SIZES[size]]
        subprocess.run([str(word) for word in (*words, made.parent)], check=True, cwd=ROOT)
    return made


def free_memory() -> float:
    """Bytes that a program may take without others being pushed out."""
    lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
    return 1024.0 * next(float(s.split()[1]) for s in lines if s.startswith("MemAvailable"))


def _tunnel(folder: Path) -> Measured:
    case = ROOT / "cases/tunnel-3d/case.yaml"
    found = {"CalculiX": peer(case, folder, "tunnel", "{}")}
    return found | {"fit": fit(case, folder / "tunnel-3d.fit.h5")}


def _cube(size: str, folder: Path) -> Measured:
    case = cube(size, folder)
    found = {"CG": peer(case, folder, "cg", '{"solver": "ITERATIVE CHOLESKY"}')}
    if size in REMOVAL:
        found["removal"] = peer(case, folder, "removal", '{"removal": true}')
    if free_memory() >= FIT_BYTES[size]:
        found["fit"] = fit(case, folder / f"cube-{size}.fit.h5")
    return found


def _scripted(folder: Path) -> Measured:
    case = cube("30k", folder)
    script = ROOT / "tests/benchmarks/scripted_loop.py"
    cost, printed = measure([sys.executable, script, case, folder / "scripted"], cwd=ROOT)
    said = json.loads(printed)
    counts = {"evaluations": float(said["evaluations"])}
    looped = Cost(cost.seconds, cost.cpu, cost.peak, counts)
    return {"script": looped, "fit": fit(case, folder / "cube-30k.fit.h5")}


def _check(folder: Path) -> Measured:
    cost, _ = program("check", cube("1000k", folder))
    return {"check": cost}


def _plastic(folder: Path) -> Measured:
    case = ROOT / "cases/cavern-plastic/case.yaml"
    return {"fit": fit(case, folder / "cavern-plastic.fit.h5")}


def _report(folder: Path) -> Measured:
    found = {}
    for name in SHIPPED:
        result = folder / f"{name}.fit.h5"
        if not result.exists():
            fit(ROOT / "cases" / name / "case.yaml", result)
        page = folder / f"{name}.html"
        runs = [program("report", result, "-o", page, "--force")[0] for _ in range(2)]
        found[name] = min(runs, key=lambda cost: cost.seconds)  # the first compiles what it imports
    return found


def _reduced(folder: Path) -> Measured:
    case, result = ROOT / "cases/tunnel-3d/case.yaml", folder / "tunnel-3d.fit.h5"
    found = {"fit": fit(case, result)}
    script = ROOT / "tests/benchmarks/reduced_evaluations.py"
    cost, printed = measure([sys.executable, script, case, result], cwd=ROOT)
    said = json.loads(printed)
    close = {"close": said["close"]}
    found["made"] = Cost(said["made"], said["made_cpu"], cost.peak)
    return found | {"reduced": Cost(said["seconds"], said["cpu"], cost.peak, close)}


ROWS: dict[str, Callable[[Path], Measured]] = {
    "tunnel-3d": _tunnel,
    **{f"cube-{size}": lambda folder, size=size: _cube(size, folder) for size in SIZES},
    "scripted": _scripted,
    "growth": lambda folder: {},
    "check-1000k": _check,
    "cavern-plastic": _plastic,
    "report": _report,
    "reduced": _reduced,
}
"""What each row measures; `LINES` has how it is shown."""


def _ratio(ours: Cost, other: Cost) -> str:
    """By the clock, and in brackets by the time of processors, which a busy machine bends less.

    >>> _ratio(Cost(10.0, 6.0, 1e9), Cost(4.0, 4.0, 1e9))
    '2.5 (1.5)'
    """
    return f"{ours.seconds / other.seconds:.2g} ({ours.cpu / other.cpu:.2g})"


def _time(cost: Cost) -> str:
    """Seconds by the clock (of processors) and memory.

    >>> _time(Cost(12.34, 20.0, 2.5e9))
    '12.3 (20) s, 2.5 GB'
    """
    return f"{cost.seconds:.3g} ({cost.cpu:.3g}) s, {cost.peak / 1e9:.2g} GB"


def _counted(cost: Cost) -> str:
    n = cost.counts.get("evaluations", 0), cost.counts.get("factorizations", 0)
    return f"{_time(cost)} ({n[0]:.0f} evaluations, {n[1]:.0f} factorizations)"


def lines(measured: Mapping[str, Measured]) -> Iterable[Line]:
    """The table of what was measured, row by row.

    Args:
        measured: row to what was measured in it.
    """
    for row, found in measured.items():
        if row == "growth":
            yield from _growth_lines(measured)
        elif row.startswith("cube-"):
            yield from _cube_lines(row, found)
        else:
            yield from LINES[row](found)


def _tunnel_lines(found: Measured) -> Iterable[Line]:
    ours, other = found["fit"], found["CalculiX"]
    what = "cases/tunnel-3d: whole fit / one CalculiX solve of its first stage"
    yield Line(what, _counted(ours), _time(other), _ratio(ours, other), "<= 3.5")


def _cube_lines(row: str, found: Measured) -> Iterable[Line]:
    size = row.removeprefix("cube-")
    targets = {"150k": ("<= 3.5", ""), "1000k": ("<= 8 GB", "")}.get(size, ("", ""))
    ours = found.get("fit")
    shown = "not begun: too little memory was free" if ours is None else _counted(ours)
    peers = (("CG", "one CalculiX step, conjugate gradients"), ("removal", "two steps, SPOOLES"))
    for (name, what), target in zip(peers, targets, strict=True):
        if name in found:
            other = found[name]
            ratio = "" if ours is None else _ratio(ours, other)
            first = f"cube of {SIZES[size]:,} unknowns: whole fit / {what}"
            yield Line(first, shown, _time(other), ratio, target)


def _scripted_lines(found: Measured) -> Iterable[Line]:
    ours, other = found["fit"], found["script"]
    what = f"cube of {SIZES['30k']:,} unknowns: scipy and CalculiX, by a script / geoident"
    peer_said = f"{_time(other)} ({other.counts['evaluations']:.0f} runs)"
    yield Line(what, _counted(ours), peer_said, _ratio(other, ours), "")


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Slope of the logarithm of times over that of sizes, by least squares.

    >>> round(exponent([1.0, 10.0, 100.0], [2.0, 2e2, 2e4]), 6)
    2.0
    """
    x, y = [math.log(n) for n in sizes], [math.log(t) for t in seconds]
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    above = sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True))
    return above / sum((a - mean_x) ** 2 for a in x)


def _growth_lines(measured: Mapping[str, Measured]) -> Iterable[Line]:
    fits = {
        n: measured[f"cube-{size}"]["fit"]
        for size, n in SIZES.items()
        if "fit" in measured.get(f"cube-{size}", {})
    }
    if len(fits) < 2:
        return
    found = exponent(list(fits), [cost.seconds for cost in fits.values()])
    what = f"growth of the time of a fit, {min(fits):,} to {max(fits):,} unknowns"
    cpu = exponent(list(fits), [cost.cpu for cost in fits.values()])
    yield Line(what, f"n^{found:.2f} (n^{cpu:.2f})", "", "", "<= n^1.5")


def _check_lines(found: Measured) -> Iterable[Line]:
    what = f"geoident check of the cube of {SIZES['1000k']:,} unknowns"
    yield Line(what, _time(found["check"]), "", "", "<= 30 s, 3 GB")


def _plastic_lines(found: Measured) -> Iterable[Line]:
    count = found["fit"].counts["factorizations"]
    yield Line("cases/cavern-plastic: factorizations", f"{count:.0f}", "", "", "<= 400")


def _report_lines(found: Measured) -> Iterable[Line]:
    slowest = max(found, key=lambda name: found[name].seconds)
    shown = ", ".join(
        f"{name} {cost.seconds:.2g} s ({cost.cpu:.2g} of processors)"
        for name, cost in found.items()
    )
    yield Line(f"geoident report: {shown}", f"{slowest} {_time(found[slowest])}", "", "", "<= 10 s")


def _reduced_lines(found: Measured) -> Iterable[Line]:
    ours, made = found["reduced"], found["made"]
    what = "cases/tunnel-3d: 100,000 evaluations of the reduced model / one fit"
    shown = f"{_time(ours)}, {100 * ours.counts['close']:.3g} % of the readings proven"
    shown += f" (made in {made.seconds:.3g} ({made.cpu:.3g}) s)"
    yield Line(what, shown, _time(found["fit"]), _ratio(ours, found["fit"]), "<= 1")


LINES: dict[str, Callable[[Measured], Iterable[Line]]] = {
    "tunnel-3d": _tunnel_lines,
    "scripted": _scripted_lines,
    "check-1000k": _check_lines,
    "cavern-plastic": _plastic_lines,
    "report": _report_lines,
    "reduced": _reduced_lines,
}


def table(measured: Mapping[str, Measured]) -> Iterable[str]:
    """The table as markdown."""
    yield "| what | geoident | peer | ratio | wanted |"
    yield "|---|---|---|---|---|"
    for line in lines(measured):
        cells = (line.what, line.ours, line.peer, line.ratio, line.target)
        yield f"| {' | '.join(cells)} |"


def made_by(rows: Sequence[str]) -> str:
    """How a table comes about: command, date, machine and versions."""
    found = [*versions(), _peer_version()]
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    return (
        f"`peers.py --rows {' '.join(rows)}`, {date.today()}; {_processor()}, "
        f"{os.cpu_count()} cores, {_memory():.0f} GB, load {load}; {', '.join(found)}"
    )


def _processor() -> str:
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def _memory() -> float:
    """GB of the machine."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9


def _peer_version() -> str:
    if calculix.PROGRAM is None:
        return calculix.REMEDY
    said = subprocess.run([calculix.PROGRAM, "-v"], capture_output=True, text=True, check=False)
    words = [word for word in said.stdout.split() if word[:1].isdigit()]
    return f"CalculiX {words[0] if words else ''}".strip()


def write(path: Path, made: str, measured: Mapping[str, Measured]) -> None:
    """Keep what was measured, for `read`."""
    rows = {row: {k: asdict(cost) for k, cost in found.items()} for row, found in measured.items()}
    text = json.dumps({"made by": made, "rows": rows}, indent=1)
    path.write_text(text + "\n", encoding="utf-8")


def read(path: Path) -> tuple[str, dict[str, Measured]]:
    """What `write` has kept."""
    kept = json.loads(path.read_text(encoding="utf-8"))
    rows = {
        row: {name: Cost(**cost) for name, cost in found.items()}
        for row, found in kept["rows"].items()
    }
    return kept["made by"], rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", nargs="+", choices=list(ROWS), default=list(ROWS))
    parser.add_argument("--folder", type=Path, default=Path("peers"), help="for meshes and results")
    parser.add_argument("--json", type=Path, help="keep what is measured here")
    parser.add_argument("--recorded", type=Path, help="show what was kept, measure nothing")
    given = parser.parse_args(arguments)
    if given.recorded:
        made, measured = read(given.recorded)
    else:
        folder = given.folder.resolve()
        folder.mkdir(parents=True, exist_ok=True)
        made, measured = made_by(given.rows), {}
        for row in given.rows:
            print(f"{row} ...", file=sys.stderr, flush=True)
            measured[row] = ROWS[row](folder)
            if given.json:
                write(given.json, made, measured)
    print(f"{made}\n")
    for line in table(measured):
        print(line)


if __name__ == "__main__":
    main()
