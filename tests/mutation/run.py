"""Changes the code at random places, one at a time, and lists the changes that no test notices.

    .venv/bin/python tests/mutation/run.py --seed 1
    .venv/bin/python tests/mutation/run.py --sample identify=60 --sample forward=60 --seed 7
    .venv/bin/python tests/mutation/run.py --again build/mutation/seed-7.jsonl
    .venv/bin/python tests/mutation/run.py --sample forward=40 --tests tests/forward tests/fem
    .venv/bin/python tests/mutation/run.py --again build/mutation/seed-7.jsonl --tests tests/cli

Slow: the default tests run once to see which test reaches which line (about twice their time), then
every change is tried on the tests that reach its line (seconds if one fails, minutes if none does).
It works on a copy in `build/mutation`, so the tree can be edited meanwhile; a run that was stopped
goes on where it was when the same command is given again. Lines that run only in a process that a
test starts are not seen.

With `--tests` (files and folders, as pytest takes them) only those are counted and tried: minutes
where the near tests of one package do. What survives them may still be caught by others, so the
survivors are tried again (`--again`) on the rest, or on a test that was just written for them.

A change that survives is read: either a test is missing, or the code means the same with it. The
latter are written down in `equivalent.toml`, with the reason, and counted apart.
"""

from __future__ import annotations

import argparse
import compileall
import contextlib
import hashlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

from cosmic_ray.mutating import use_mutation
from cosmic_ray.testing import run_tests
from cosmic_ray.work_item import TestOutcome
from equivalent import Place, Same, listed, place
from selection import Selection
from sites import Mutant, draw

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {"identify": 40, "forward": 40, "fem": 25, "workflow": 15, "report": 30}
"""How many changes are tried in each package without `--sample`."""
PICTURES = re.compile(r"/report/(drawing/(?!scene|sheets)|(.*/)?(html|svg|page|figures)\.py)")
"""Modules of `report` without arithmetic that a test could judge: layout and markup."""
PYTEST = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider")
FIRST = 10.0
"""Seconds of quick tests that a change meets before the others are begun."""


@dataclass(frozen=True)
class Verdict:
    """What became of a change.

    Attributes:
        mutant: the change.
        caught: the test that failed, "timeout", or empty if the change survived.
        tests: number of tests that ran in all.
        was: the lines before, without indentation.
        became: the lines after.
        beside: the lines before and after those.
        package: where the change is.
    """

    mutant: Mutant
    caught: str
    tests: int
    was: str
    became: str
    beside: tuple[str, ...] = ()

    @property
    def package(self) -> str:
        return self.mutant.module.split("/")[1]


class Bench:
    """A copy of the repository in which the code is changed and tests are run.

    Args:
        folder: for the copy and for what is counted on it.
        most: seconds of tests that a change meets at most.
        packages: where the changes will be; lines elsewhere are not counted.
        tests: files and folders of the tests that are counted and tried; all default ones if empty.
    """

    def __init__(self, folder: Path, most: float, packages: list[str], tests: list[str]) -> None:
        self.folder = folder
        self._most = most
        self._packages = packages
        self._tests = tests
        self.tree = folder / "tree"
        os.environ["PYTHONPATH"] = os.pathsep.join([str(self.tree), str(Path(__file__).parent)])
        os.environ["MUTATION_FOLDER"] = str(folder)
        if self._copy():
            self._count()
        (folder / "state").write_text(self.state)
        os.chdir(self.tree)
        self._selection = Selection(folder, self.tree)
        self._alone: dict[str, bool] = {}

    def _copy(self) -> bool:
        """Copy what git knows or does not ignore; whether the tests are to be counted again."""
        command = ["git", "ls-files", "-co", "--exclude-standard", "-z"]
        listed = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout
        names = sorted({name for name in listed.split("\0") if name and (ROOT / name).is_file()})
        content = {name: (ROOT / name).read_bytes() for name in names}
        counted = (content, self._packages, self._tests)
        state = hashlib.sha256(repr(counted).encode()).hexdigest()[:8]
        shutil.rmtree(self.tree, ignore_errors=True)
        for name, what in content.items():
            path = self.tree / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(what)
            path.chmod((ROOT / name).stat().st_mode)
        compileall.compile_dir(self.tree / "geoident", quiet=1)
        kept = self.folder / "state"
        changed = not kept.exists() or kept.read_text() != state
        kept.unlink(missing_ok=True)
        self.state = state
        return changed

    def _count(self) -> None:
        """Run the default tests and keep which lines each reaches."""
        print("Running the tests once to see what each reaches ...", flush=True)
        log = self.folder / "reached.log"
        os.environ["MUTATION_PACKAGES"] = os.pathsep.join(self._packages)
        with log.open("w") as stream:
            command = [*PYTEST, "-p", "reached", "--continue-on-collection-errors", *self._tests]
            code = subprocess.run(command, cwd=self.tree, stdout=stream, check=False).returncode
        if code > 1:
            raise SystemExit(f"the tests do not run: see {log}")

    def judge(self, mutant: Mutant) -> Verdict:
        """Run the tests that reach a change until one fails."""
        tests = self._selection.tests(mutant.module, mutant.line)
        cost = self._selection.seconds
        total, first, rest = 0.0, [], []
        for test in tests:
            total += cost[test]
            if total <= min(FIRST, self._most) or not first:
                first.append(test)
            elif total <= self._most:
                rest.append(test)
        with use_mutation(Path(mutant.module), mutant.make(), mutant.occurrence) as (old, new):
            place, became = _difference(old, new)
            caught = self._run(first) or self._run(rest)
        while caught not in {"", "timeout"} and not self._passes_alone(caught):
            print(f"  left out, fails by itself: {caught}", flush=True)
            first, rest = ([one for one in part if one != caught] for part in (first, rest))
            with use_mutation(Path(mutant.module), mutant.make(), mutant.occurrence):
                caught = self._run(first) or self._run(rest)
        tried = len(first) + len(rest)
        return Verdict(mutant, caught, tried, place.lines, became, place.beside)

    def _run(self, tests: list[str]) -> str:
        """The first test that fails, "timeout", or nothing."""
        if not tests:
            return ""
        names = self.folder / "tests.txt"
        names.write_text("".join(f"{test}\n" for test in tests))
        seconds = sum(self._selection.seconds[test] for test in tests)
        command = shlex.join([*PYTEST, "-x", "--tb=no", f"@{names}"])
        outcome, output = run_tests(command, 60.0 + 5.0 * seconds)
        if outcome is TestOutcome.SURVIVED:
            return ""
        failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", output, re.MULTILINE)
        return failed[1] if failed else output.strip()[-200:] or "does not start"

    def _passes_alone(self, test: str) -> bool:
        """Whether a test passes on the code as it is, run without others."""
        if test not in self._selection.seconds:
            return True
        if test not in self._alone:
            self._alone[test] = self._run([test]) == ""
        return self._alone[test]


def _difference(old: str, new: str) -> tuple[Place, str]:
    """The lines that differ, without what is common at both ends: before, and after."""
    before, after = old.splitlines(), new.splitlines()
    first = _common(before, after)
    end = _common(before[first:][::-1], after[first:][::-1])
    changed = place(after, first, len(after) - end)
    return place(before, first, len(before) - end), changed.lines


def _common(one: list[str], other: list[str]) -> int:
    """How many lines are the same before the first that differs."""
    pairs = zip(one, other, strict=False)
    return next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(one), len(other)))


def _modules(tree: Path, package: str) -> list[str]:
    found = (str(path.relative_to(tree)) for path in (tree / "geoident" / package).rglob("*.py"))
    return sorted(one for one in found if not PICTURES.search(one))


def _reason(verdict: Verdict, known: list[Same]) -> str:
    """Why a change means the same, if that is written down."""
    file = verdict.mutant.module.removeprefix("geoident/")
    place = Place(verdict.was, tuple(verdict.beside))
    return next((one.reason for one in known if one.is_of(file, place, verdict.became)), "")


def _kept(path: Path) -> list[Verdict]:
    """Verdicts of a file of results."""
    lines = path.read_text().splitlines() if path.exists() else []
    rows = [json.loads(line) for line in lines]
    return [Verdict(**{**row, "mutant": Mutant(**row["mutant"])}) for row in rows]


def _summary(verdicts: list[Verdict]) -> str:
    """Shares by package, and the survivors."""
    known = listed()
    lines = ["", "package    tried  equivalent  caught  survived   caught of those not equivalent"]
    for package in [*dict.fromkeys(v.package for v in verdicts), "all"]:
        some = [v for v in verdicts if package in (v.package, "all")]
        count = Counter(
            "caught" if v.caught else "known" if _reason(v, known) else "alive" for v in some
        )
        share = 100 * count["caught"] / max(count["caught"] + count["alive"], 1)
        lines.append(
            f"{package:10} {len(some):5} {count['known']:11} {count['caught']:7}"
            f" {count['alive']:9} {share:9.1f} %"
        )
    for verdict in sorted((v for v in verdicts if not v.caught), key=lambda v: v.mutant.module):
        where = f"{verdict.mutant.module}:{verdict.mutant.line}"
        lines += ["", f"{where}  {verdict.mutant.definition}  ({verdict.tests} tests)"]
        lines += [f"  - {verdict.was}", f"  + {verdict.became}"]
        if reason := _reason(verdict, known):
            lines.append(f"  the same: {reason}")
    return "\n".join(lines)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--sample", action="append", metavar="PACKAGE=N", help="changes to try")
    parser.add_argument("--seed", type=int, default=1, help="of the sample")
    parser.add_argument(
        "--seconds", type=float, default=300.0, help="of tests for a change that no test notices"
    )
    parser.add_argument("--again", type=Path, help="only what survived in this file of results")
    parser.add_argument("--tests", nargs="+", default=[], metavar="PATH", help="only these tests")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "mutation")
    return parser.parse_args()


def _counts(options: argparse.Namespace) -> dict[str, int]:
    """How many changes to try in each package."""
    if not options.sample:
        return PACKAGES
    return {package: int(count) for package, count in (text.split("=") for text in options.sample)}


def _sample(tree: Path, counts: dict[str, int], seed: int) -> list[Mutant]:
    """The changes to try, packages mixed so that a run that is stopped has some of each."""
    found: list[tuple[float, Mutant]] = []
    for package, count in counts.items():
        mutants, sites = draw(tree, _modules(tree, package), count, seed)
        print(f"{package}: {len(mutants)} of {sites} places")
        found += [((i + 0.5) / len(mutants), mutant) for i, mutant in enumerate(mutants)]
    return [mutant for _, mutant in sorted(found, key=lambda pair: pair[0])]


def main() -> None:
    """Run the command."""
    options = _options()
    folder = options.folder.resolve()
    again = _kept(options.again.resolve()) if options.again else []
    folder.mkdir(parents=True, exist_ok=True)
    alive = {verdict.mutant: verdict for verdict in again if not verdict.caught}
    counts = _counts(options)
    packages = sorted({verdict.package for verdict in alive.values()} or counts)
    bench = Bench(folder, options.seconds, packages, options.tests)
    mutants = list(alive) if options.again else _sample(bench.tree, counts, options.seed)
    stem = f"again-{options.again.stem}" if options.again else f"seed-{options.seed}"
    results = folder / f"{stem}-{bench.state}.jsonl"
    done = {verdict.mutant: verdict for verdict in _kept(results)}
    for number, mutant in enumerate(mutants, 1):
        if mutant not in done:
            verdict = bench.judge(mutant)
            done[mutant] = verdict
            if mutant in alive and alive[mutant].was != verdict.was:
                raise SystemExit(f"{mutant.module} is another file now: draw a new sample")
            with results.open("a") as stream:
                stream.write(json.dumps(asdict(verdict)) + "\n")
            what = "caught  " if verdict.caught else "SURVIVED"
            print(f"{number:4}/{len(mutants)} {what} {mutant.module}:{mutant.line}", flush=True)
    print(_summary([done[mutant] for mutant in mutants]))
    print(f"\nResults: {results}")


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with contextlib.suppress(KeyboardInterrupt):
        main()
