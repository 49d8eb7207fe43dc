"""Whether bands hold where the ground is not like its model: coverage by repetitions.

    python tests/benchmarks/wrong_models.py --runs 50
    python tests/benchmarks/wrong_models.py --runs 50 --truths right field-30 --set estimate none
    python tests/benchmarks/wrong_models.py --cavern --cavern-runs 10

A cavern in plane strain is excavated in a pilot drift, a heading and two benches. What the gauges
read up to the first bench is fitted (two parameters, ten readings; a hundred with ``--gauges
many``), the second bench is predicted with its 95 % bands. The readings come from a truth on a
finer mesh that differs from the model as its name says, with noise of the size of the accuracies.
Each run has its own noise and, where the truth is drawn, its own truth. ``--cavern`` does the same
with cases/cavern, read up to bench 2, and its three later benches.

What came of each run is kept with ``--kept FILE``: the same command goes on from there, as long as
the program is the same, so that a table can be made in pieces, or by several processes with
different truths (each with a file of its own; ``--kept`` takes several, and writes to the first).

The columns of the table, for every truth and every setting of ``fit.model_error``:

    inside             later readings in their 95 % band
    width, accuracies  median half width of these bands, in stated accuracies
    width, oracles     the same, in widths of an oracle who knows the covariance of truth less model
    error, mm          root mean square of prediction less truth without noise
    parameters         true ones inside their 95 % interval
    exit 4             runs that end so: poor fit, or not determined
    misfit             runs with a finding on a misfit or a large model error
    backtest           ... that the backtest of the last fitted stage went badly
    extrapolation      ... that later stages load the ground beyond what was tested
    silent             runs with exit 0 and none of these
    inside, silent     later readings of those runs in their band
    size               median of the estimated model error, of the computed motion

The truths are those of `wrong_ground.py`.
"""

from __future__ import annotations

import argparse
import hashlib
import inspect
import json
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import numpy as np  # noqa: E402
import wrong_ground  # noqa: E402
from wrong_ground import DAYS, TRUTHS, Cavern, Site, true_readings  # noqa: E402

import geoident  # noqa: E402
from geoident.api import fit, load_case  # noqa: E402
from geoident.fem.solvers import pick_solver  # noqa: E402
from geoident.forward.model import staged_model  # noqa: E402
from geoident.model.results.findings import sentences_of  # noqa: E402
from geoident.model.results.result import Result  # noqa: E402

NORMAL95 = 1.959964
WORDS = {
    "misfit": (
        "times as large as the stated accuracies",
        "tell a model error",
        "explain the residuals better",
        "The model meets",
    ),
    "backtest": ("Backtest of",),
    "extrapolation": ("an elastic model has not been tested there",),
}
"""Of findings: a misfit, its size, what may be behind it; bands that did not hold; more stress."""


# The oracle --------------------------------------------------------------------------------------


def oracle(site: Site, name: str, truths: Sequence[int]) -> np.ndarray:
    """Half widths (m,) of the 95 % bands of one who knows how this truth differs from the model.

    Generalized least squares by linearization at the true parameters. The covariance of the
    readings is that of the noise as it is, plus the mean over the truths of d d^T with d what they
    read less what the model computes. Of a truth that is one and the same in all runs the oracle
    so knows the shape and the size of the difference, not its sign. Places that are later read are
    predicted from the others (kriging with the parameters as unknown trend).

    Args:
        site: meshes and truths.
        name: of the truth.
        truths: numbers of the runs whose truths make the covariance.

    Returns:
        Half widths at the places of `later_places`, m.
    """
    truth, case = TRUTHS[name], site.truth[0]
    mesh = site.coarse_mesh if truth.coarse else site.model_mesh
    there, of_model = site.read(mesh, truth)
    model = staged_model(of_model, there, solver=pick_solver("auto"))
    base = site.readings(model)
    used, later = read_places(site, site.fitted), read_places(site, site.later)
    rows, columns = (np.concatenate([used[k], later[k]]) for k in (0, 1))
    left = np.array([(true_readings(site, name, run) - base)[rows, columns] for run in truths])
    sd = np.array([channel.accuracy for channel in case.channels])[rows]
    days = np.where(np.arange(len(rows)) < len(used[0]), DAYS if truth.zero else 1, 1)
    covariance = left.T @ left / len(left) + np.diag((truth.noise * sd) ** 2 / days)
    covariance += (truth.zero * sd) ** 2 * (rows[:, None] == rows)
    jacobian = []
    for parameter in model.names:
        step = 1e-3 * site.true[parameter]
        up, down = (
            site.readings(model, {parameter: site.true[parameter] + s}) for s in (step, -step)
        )
        jacobian.append(((up - down) / (2 * step) * site.true[parameter])[rows, columns])
    precision = np.diag(
        [
            0.0 if p.prior is None else (site.true[p.name] / p.prior.sd) ** 2
            for p in model.case.parameters
        ]
    )
    n, slopes = len(used[0]), np.array(jacobian).T
    weights = np.linalg.solve(covariance[:n, :n], covariance[:n, n:])
    trend = slopes[n:] - weights.T @ slopes[:n]
    known = slopes[:n].T @ np.linalg.solve(covariance[:n, :n], slopes[:n]) + precision
    variance = covariance[n:, n:] - covariance[n:, :n] @ weights
    variance = variance + trend @ np.linalg.solve(known, trend.T)
    return NORMAL95 * np.sqrt(np.diag(variance))


def read_places(site: Site, stages: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Channel and stage (m,), (m,) of what is read in some stages."""
    case = site.truth[0]
    exact, names = true_readings(site, "right", 0), [s.name for s in case.stages]
    found = [
        (i, names.index(stage))
        for i, channel in enumerate(case.channels)
        for stage in stages
        if np.isfinite(exact[i, names.index(stage)]) and channel.zero != stage
    ]
    rows, columns = np.array(found).T
    return rows, columns


# Runs --------------------------------------------------------------------------------------------


SAYING = ("cli", "report", "__main__.py")
"""Parts of the program that only show what others computed."""


def source_digest() -> str:
    """Of what computes a run: runs of another program, or of other truths, are not taken."""
    root = Path(geoident.__file__).parent
    found = hashlib.sha256(Path(wrong_ground.__file__).read_bytes())
    for path in sorted(root.rglob("*.py")):
        if path.relative_to(root).parts[0] not in SAYING:
            found.update(path.read_bytes())
    for part in (AnalysisRun, one_run, _judged, read_places):
        found.update(inspect.getsource(part).encode())
    found.update(repr(WORDS).encode())
    return found.hexdigest()[:16]


@dataclass(frozen=True)
class AnalysisRun:
    """What came of one run.

    Args:
        inside: (m,) later readings in their band.
        width: (m,) half width of the bands, m.
        accuracy: (m,) of these readings, m.
        error: (m,) of the prediction against the truth without noise, m.
        covered: (n,) true parameters in their intervals.
        exit_code: of the fit.
        said: which kinds of `WORDS` its findings have.
        size: of the model error; 0 for none.
    """

    inside: np.ndarray
    width: np.ndarray
    accuracy: np.ndarray
    error: np.ndarray
    covered: np.ndarray
    exit_code: int
    said: frozenset[str]
    size: float

    @classmethod
    def from_text(cls, text: str) -> AnalysisRun:
        """What `as_text` wrote."""
        raw = json.loads(text)
        arrays = {k: np.array(v) for k, v in raw.items() if isinstance(v, list) and k != "said"}
        return cls(**{**raw, **arrays, "said": frozenset(raw["said"])})

    def as_text(self) -> str:
        """One line of JSON."""
        raw = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(self).items()}
        return json.dumps(raw | {"said": sorted(self.said), "exit_code": int(self.exit_code)})

    @property
    def silent(self) -> bool:
        """Whether it ended with exit 0 and without any of the words."""
        return self.exit_code == 0 and not self.said


@dataclass
class Kept:
    """Runs of the same program that were made before.

    Args:
        paths: of files with a key and a run in each line; new ones go to the first.
        digest: of the program.
        runs: key to what came of it.
    """

    paths: Sequence[Path]
    digest: str = field(default_factory=source_digest)
    runs: dict[str, AnalysisRun] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for path in self.paths:
            for line in path.read_text().splitlines() if path.exists() else ():
                key, _, text = line.partition("\t")
                self.runs[key] = AnalysisRun.from_text(text)

    def run(self, key: str, make: Callable[[], AnalysisRun]) -> AnalysisRun:
        """A run, made if it was not made before.

        Args:
            key: of site, truth, setting and number.
            make: makes it.
        """
        key = f"{self.digest} {key}"
        if key not in self.runs:
            self.runs[key] = make()
            if self.paths:
                with self.paths[0].open("a") as file:
                    file.write(f"{key}\t{self.runs[key].as_text()}\n")
        return self.runs[key]


def one_run(site: Site, name: str, run: int, setting: str, folder: Path) -> AnalysisRun:
    """Draw readings, fit, compare.

    Args:
        site: meshes and truths.
        name: of the truth.
        run: its number.
        setting: of ``fit.model_error``; empty to leave it out.
        folder: for the files of the run.
    """
    truth = TRUTHS[name]
    exact = true_readings(site, name, run)
    generator = np.random.default_rng([run, 2])
    channels, stages = site.truth[0].channels, [s.name for s in site.truth[0].stages]
    sd = np.array([channel.accuracy for channel in channels])
    noisy = exact + truth.noise * sd[:, None] * generator.normal(size=exact.shape)
    offset = truth.zero * sd * generator.normal(size=len(exact))
    lines = ["gauge,stage,value,unit"]
    for i, j in zip(*read_places(site, site.fitted), strict=True):
        days = DAYS if truth.zero else 1
        values = exact[i, j] + offset[i] + sd[i] * generator.normal(size=days)
        values = values if truth.zero else noisy[i, j : j + 1]
        lines += [f"{channels[i].name},{stages[j]},{1e3 * v!r},mm" for v in values.tolist()]
    (folder / "readings.csv").write_text("\n".join(lines) + "\n")
    mesh = site.coarse_mesh if truth.coarse else site.model_mesh
    file = "{file: readings.csv, repeated_readings: all}" if truth.zero else "readings.csv"
    path = site.write(folder, mesh, file, truth)
    overrides: dict[str, object] = {"fit.model_error": setting} if setting else {}
    found = fit(load_case(path, overrides), output=folder / "found.h5", force=True, fresh=True)
    return _judged(site, found.data, exact, noisy + offset[:, None])


def _judged(site: Site, result: Result, exact: np.ndarray, later: np.ndarray) -> AnalysisRun:
    assert result.prediction is not None
    assert result.gauges.stages == tuple(s.name for s in site.truth[0].stages)
    there = read_places(site, site.later)
    mean, lower, upper = (
        getattr(result.prediction, part)[there] for part in ("mean", "lower95", "upper95")
    )
    table = result.parameters
    true = np.array([site.true[name] for name in table.names])
    found = result.model_error
    said = {
        kind
        for kind, words in WORDS.items()
        if any(word in text for text in sentences_of(result.findings) for word in words)
    }
    return AnalysisRun(
        (later[there] >= lower) & (later[there] <= upper),
        0.5 * (upper - lower),
        np.array([channel.accuracy for channel in site.truth[0].channels])[there[0]],
        mean - exact[there],
        (true >= table.lower95) & (true <= table.upper95),
        result.exit_code,
        frozenset(said),
        0.0 if found is None else float(found.size),
    )


# Tables ------------------------------------------------------------------------------------------

COLUMNS = (
    "truth", "model error", "runs", "inside", "width, accuracies", "width, oracles", "error, mm",
    "parameters", "exit 4", "misfit", "backtest", "extrapolation", "silent", "inside, silent",
    "size",
)  # fmt: skip


def cells(
    name: str, setting: str, runs: Sequence[AnalysisRun], known: np.ndarray | None
) -> list[str]:
    """One row of the table, one text for each of `COLUMNS`.

    Args:
        name: of the truth.
        setting: of the model error.
        runs: what came of them.
        known: (m,) half widths of the oracle's bands, m; None where there is none.
    """
    silent = [run for run in runs if run.silent]
    error = np.sqrt(np.mean(np.concatenate([run.error for run in runs]) ** 2))
    against = "-"
    if known is not None:
        against = f"{np.median([np.median(run.width / known) for run in runs]):.2f}"
    return [
        name,
        setting or "default",
        str(len(runs)),
        _percent([run.inside for run in runs]),
        f"{np.median([np.median(run.width / run.accuracy) for run in runs]):.2f}",
        against,
        f"{1e3 * error:.2f}",
        _percent([run.covered for run in runs]),
        str(sum(run.exit_code != 0 for run in runs)),
        *(str(sum(kind in run.said for run in runs)) for kind in WORDS),
        str(len(silent)),
        _percent([run.inside for run in silent]),
        f"{100 * np.median([run.size for run in runs]):.0f} %",
    ]


def _percent(flags: Sequence[np.ndarray]) -> str:
    return f"{100 * np.concatenate(flags).mean():.0f} %" if flags else "-"


def all_rows(
    site: Site,
    names: Sequence[str],
    settings: Sequence[str],
    count: int,
    *,
    seed: int,
    truths: int,
    kept: Kept,
) -> Iterator[list[str]]:
    """Rows of the table.

    Args:
        site: meshes and truths.
        names: of the truths.
        settings: of the model error.
        count: runs of each.
        seed: number of the first run.
        truths: drawn for the covariance of the oracle; 0 for no oracle.
        kept: runs that were made before.
    """
    where = f"{type(site).__name__} {'many' if site.many else 'few'}"
    for name in names:
        known = None
        if truths:
            drawn = truths if TRUTHS[name].drawn else 1
            known = oracle(site, name, range(seed, seed + drawn))
        for setting in settings:
            numbers = range(seed, seed + count)
            runs = [
                kept.run(
                    f"{where} {name} {setting} {run}",
                    partial(one_run, site, name, run, setting, site.folder),
                )
                for run in numbers
            ]
            yield cells(name, setting, runs, known)


def tables(given: argparse.Namespace, *, cavern: bool) -> Iterator[str]:
    """Lines of the table in markdown.

    Args:
        given: options of `options`.
        cavern: of cases/cavern.
    """
    yield f"| {' | '.join(COLUMNS)} |"
    yield "|---" * len(COLUMNS) + "|"
    with tempfile.TemporaryDirectory() as folder:
        many = given.gauges == "many"
        site = Cavern(Path(folder)) if cavern else Site(Path(folder), many)
        truths = 0 if many else given.cavern_oracle if cavern else given.oracle
        count = given.cavern_runs if cavern else given.runs
        kept = Kept([Path(path) for path in given.kept])
        rows = all_rows(
            site, given.truths, given.settings, count, seed=given.seed, truths=truths, kept=kept
        )
        for row in rows:
            yield f"| {' | '.join(row)} |"


def options(parser: argparse.ArgumentParser) -> None:
    """Add what the tables can be told."""
    parser.add_argument("--runs", type=int, default=50, help="of each row")
    parser.add_argument("--cavern-runs", type=int, default=10, help="of each row of cases/cavern")
    parser.add_argument("--truths", nargs="+", choices=list(TRUTHS), default=list(TRUTHS))
    parser.add_argument("--set", nargs="+", default=["estimate", "none"], dest="settings")
    parser.add_argument("--gauges", choices=("few", "many"), default="few")
    parser.add_argument("--oracle", type=int, default=100, help="truths drawn for it; 0: without")
    parser.add_argument("--cavern-oracle", type=int, default=20, help="the same of cases/cavern")
    parser.add_argument("--kept", nargs="+", default=[], help="files of runs, to go on from")
    parser.add_argument("--seed", type=int, default=0, help="number of the first run")


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options(parser)
    parser.add_argument("--cavern", action="store_true", help="cases/cavern")
    given = parser.parse_args(arguments)
    for line in tables(given, cavern=given.cavern):
        print(line, flush=True)


if __name__ == "__main__":
    main()
