"""Intervals and bands where accuracies are estimated, by a table of runs that is exactly linear."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy import stats

import geoident
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.assessment.unknown_variances import OverAccuracies, with_possible
from geoident.identify.assessment.variance_components import (
    RestrictedLikelihood,
    estimate_components,
)
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.gauges import Channel, ErrorParts, Reading
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.costs import Counts
from geoident.model.results.findings import sentences_of
from geoident.workflow.estimating.accuracies import (
    Possible,
    accuracy_table,
    weighed,
    with_accuracies,
)
from geoident.workflow.estimating.predictions import KnownErrors, predict_stages
from geoident.workflow.running.readings import error_structure

N = 16
HEAD = """\
format: geoident-case/1
model: {kind: table, file: runs.csv}
parameters:
  a: {start: 1, bounds: [-200, 200], scale: linear}
  b: {start: 1, bounds: [-200, 200], scale: linear}
stages: [{name: now}, {name: later}]
"""
TRUTH, PRIOR_SD = np.array([3.0, -2.0]), 1.0


class Line:
    """Readings a + b x_i, and later ones a + b (x_i + 1); every second of another group."""

    def __init__(self, folder, n=N, groups=1):
        self.folder, self.n, self.group = folder, n, np.arange(n) % groups
        x = np.linspace(0.0, 1.0, n)
        self.now, self.later = (np.column_stack([np.ones(n), x + add]) for add in (0.0, 1.0))
        runs = np.random.default_rng(0).uniform(-200.0, 200.0, (24, 2))
        names = [f"G{i} @ {stage} [mm]" for stage in ("now", "later") for i in range(n)]
        table = np.column_stack([runs, runs @ self.now.T, runs @ self.later.T])
        lines = [["a", "b", *names], *([f"{v:.15g}" for v in row] for row in table.tolist())]
        (folder / "runs.csv").write_text("\n".join(map(",".join, lines)) + "\n")

    def case(self, y, prior=None, fit=""):
        """A case with readings y (n,), mm, all of 1 mm as it states."""
        gauges = [f"  G{i}: {{kind: reading, accuracy: {{{self.part(i)}}}}}" for i in range(self.n)]
        readings = [
            f"  - {{gauge: G{i}, stage: now, value: {v!r} mm}}" for i, v in enumerate(y.tolist())
        ]
        end = f"fit: {{accuracies: estimate, backtest: false, model_error: none{fit}}}"
        head = HEAD
        if prior is not None:
            known = f"a: {{prior: {{mean: {prior!r}, sd: {PRIOR_SD}}}, start"
            head = HEAD.replace("a: {start", known)
        path = self.folder / "case.yaml"
        path.write_text("\n".join([head, "gauges:", *gauges, "readings:", *readings, end]) + "\n")
        return path

    def part(self, i):
        return "reading: 1 mm"


def test_one_unknown_accuracy_gives_the_intervals_of_the_textbooks(tmp_path):
    line = Line(tmp_path)
    y = line.now @ TRUTH + 4.0 * np.random.default_rng(5).standard_normal(N)
    found = geoident.fit(line.case(y))
    A, later = line.now, line.later
    p, (rss,), *_ = np.linalg.lstsq(A, y, rcond=None)
    s, inverse = np.sqrt(rss / (N - 2)), np.linalg.inv(A.T @ A)
    half = stats.t.ppf(0.975, N - 2) * s * np.sqrt(np.diag(inverse))
    table = found.data.parameters
    for got, expected in ((table.lower95, p - half), (table.upper95, p + half)):
        np.testing.assert_allclose(got, expected, atol=1e-3 * half.min())
    np.testing.assert_allclose(table.sd, s * np.sqrt(np.diag(inverse)), rtol=1e-4)
    spread = np.sqrt(1.0 + np.einsum("ij,jk,ik->i", later, inverse, later))
    half = 1e-3 * stats.t.ppf(0.975, N - 2) * s * spread
    bands = found.data.prediction
    centre = 1e-3 * later @ p
    for got, expected in ((bands.lower95, centre - half), (bands.upper95, centre + half)):
        np.testing.assert_allclose(got[:, 1], expected, atol=1e-3 * half.min())
    (said,) = [note for note in found.data.notes if "degrees of freedom" in note]
    assert "they have 14 degrees of freedom" in said
    assert not [
        finding for finding in sentences_of(found.data.findings) if "degrees of freedom" in finding
    ]
    again = geoident.predict(found.path).data.prediction
    np.testing.assert_allclose(again.upper95, bands.upper95, rtol=1e-12)


def textbook(x, y, new):
    """Predicted a + b x and half the width of its band of 95 %, by Student's t."""
    A, B = (np.column_stack([np.ones(len(at)), at]) for at in (x, new))
    p, (rss,), *_ = np.linalg.lstsq(A, y, rcond=None)
    spread = np.sqrt(1.0 + np.einsum("ij,jk,ik->i", B, np.linalg.inv(A.T @ A), B))
    t = stats.t.ppf(0.975, len(y) - 2)
    return B @ p, t * np.sqrt(rss / (len(y) - 2)) * spread


@pytest.mark.parametrize("several", ["all", "mean"])
def test_bands_of_readings_that_were_taken_are_as_wide_as_of_others(tmp_path, several):
    """Also where they are several, and as the fit has them or another case."""
    n = 6
    line = Line(tmp_path, n)
    y = line.now @ TRUTH + 4.0 * np.random.default_rng(8).standard_normal(n)
    path = line.case(y, fit=", stages: [now]")
    rows = [f"G{i},now,{v!r},mm\n" for i, v in enumerate(y.tolist())]
    later = [f"G{i},later,{v},mm\n" for i in range(3) for v in (1.0, 2.0)]
    (tmp_path / "read.csv").write_text("gauge,stage,value,unit\n" + "".join(rows + later))
    head, _, rest = path.read_text().partition("readings:")
    end = rest[rest.index("fit:") :]
    path.write_text(f"{head}readings: {{file: read.csv, repeated_readings: {several}}}\n{end}")
    found = geoident.fit(path)
    centre, half = textbook(line.now[:, 1], y, line.later[:, 1])
    A, B = line.now, line.later[:3]
    leverage = np.einsum("ij,jk,ik->i", B, np.linalg.inv(A.T @ A), B)
    half[:3] *= np.sqrt((0.5 + leverage) / (1.0 + leverage))  # the mean of two readings
    copy = tmp_path / "copy.yaml"
    copy.write_text(path.read_text())
    copied = geoident.predict(found.path, case=copy, output=tmp_path / "copy.h5")
    for one in (found, geoident.predict(found.path), copied):
        bands = one.data.prediction
        np.testing.assert_allclose(1e3 * bands.mean[:, 1], centre, rtol=1e-6)
        width = 1e3 * (bands.upper95 - bands.lower95)[:, 1]
        np.testing.assert_allclose(width, 2.0 * half, rtol=1e-3)


def test_a_gauge_that_another_case_adds_is_as_accurate_as_the_fit_found_its_kind(tmp_path):
    """As in a fit of that case, which tells its kind from the same readings."""
    n = 6
    line = Line(tmp_path, n)
    y = line.now @ TRUTH + 4.0 * np.random.default_rng(8).standard_normal(n)
    wide = line.case(y).read_text().replace("- {gauge: G5", "# {gauge: G5")
    (tmp_path / "wide.yaml").write_text(wide)
    gauge = "  G5: {kind: reading, accuracy: {reading: 1 mm}}\n"
    few = tmp_path / "few.yaml"
    cells = [row.split(",") for row in (tmp_path / "runs.csv").read_text().splitlines()]
    kept = [k for k, name in enumerate(cells[0]) if not name.startswith("G5")]
    (tmp_path / "few.csv").write_text(
        "\n".join(",".join(row[k] for k in kept) for row in cells) + "\n"
    )
    few.write_text(wide.replace(gauge, "").replace("runs.csv", "few.csv"))
    centre, half = textbook(line.now[:5, 1], y[:5], line.later[:, 1])
    known = geoident.predict(geoident.fit(few).path, case=tmp_path / "wide.yaml")
    for one in (geoident.fit(tmp_path / "wide.yaml"), known):
        bands = one.data.prediction
        np.testing.assert_allclose(1e3 * bands.mean[:, 1], centre, rtol=1e-6)
        width = 1e3 * (bands.upper95 - bands.lower95)[:, 1]
        np.testing.assert_allclose(width, 2.0 * half, rtol=1e-3)


@pytest.mark.slow  # the density of the draws, at the accuracies in use: `test_posterior.py`
def test_draws_have_the_quantiles_of_students_t(tmp_path):
    n = 8
    line = Line(tmp_path, n)
    y = line.now @ TRUTH + 4.0 * np.random.default_rng(6).standard_normal(n)
    found = geoident.fit(line.case(y))
    drawn = geoident.sample(found.path, draws=20_000, effective=8_000)
    p, (rss,), *_ = np.linalg.lstsq(line.now, y, rcond=None)
    s, inverse = np.sqrt(rss / (n - 2)), np.linalg.inv(line.now.T @ line.now)
    levels, t = (0.025, 0.25, 0.75, 0.975), stats.t(n - 2)
    for k in range(2):
        scaled = (drawn.draws[:, k] - p[k]) / (s * np.sqrt(inverse[k, k]))
        below = [np.mean(scaled <= t.ppf(level)) for level in levels]
        np.testing.assert_allclose(below, levels, atol=0.012)
    spread = np.sqrt(1.0 + np.einsum("ij,jk,ik->i", line.later, inverse, line.later))
    half = 1e-3 * t.ppf(0.975) * s * spread
    bands = drawn.data.prediction
    width = bands.upper95[:, 1] - bands.lower95[:, 1]
    np.testing.assert_allclose(width, 2.0 * half, rtol=0.06)


class Linear:
    """v = J p; costs nothing."""

    counts, names = Counts(), ("a", "b")

    def __init__(self, J):
        self.J = J

    def admissible(self, p):
        return None

    def readings(self, p):
        return self.J @ p

    def evaluate(self, p):
        return self.J @ p, self.J


def solved(problem):
    return gauss_newton(problem, GaussNewtonOptions(), lambda iteration: None)


KINDS = ("settlement", "extensometer")


def gauge(number, kind):
    parts = ErrorParts(1.0, estimated=(("reading", kind),))
    name = f"G{number}"
    return Channel(name, name, kind, None, (0.0, 0.0), (1.0, 0.0), 1.0, "virgin", errors=parts)


def coverage(n, sizes, repeats, *, prior=False):
    """How often intervals and bands hold the truth, and those at the likeliest accuracies.

    Args:
        n: readings a + b x of gauges whose kinds take turns, all of which state an accuracy of one.
        sizes: true accuracies of the kinds.
        repeats: number of drawn sets of readings.
        prior: whether a is known to 1, too.

    Returns:
        (3,) of a, of b, and of readings a + b (x + 1); and (3,) as if the accuracies were given.
    """
    rng, of = np.random.default_rng(n + len(sizes)), np.arange(n) % len(sizes)
    x, sd = np.linspace(0.0, 1.0, n), np.array(sizes)[of]
    J, later = (np.column_stack([np.ones(n), x + add]) for add in (0.0, 1.0))
    channels = tuple(gauge(i, KINDS[k]) for i, k in enumerate(of.tolist()))
    stages = tuple(SimpleNamespace(name=name) for name in ("now", "later"))
    rows = [(channel, Reading(channel.name, "now", None)) for channel in channels]
    case = CaseLike(channels, stages, tuple(reading for _, reading in rows))
    structure, used = error_structure(rows), np.ones(n, dtype=bool)
    computed, wanted = np.full((n, 2), np.nan), np.array([False, True])
    right, plain = [], []
    for _ in range(repeats):
        truth = TRUTH + np.array([PRIOR_SD * prior, 0.0]) * rng.standard_normal(2)
        y = J @ truth + sd * rng.standard_normal(n)
        y_later = later @ truth + sd * rng.standard_normal(n)
        known = Prior(3.0, PRIOR_SD, "normal") if prior else None
        unknown = (Parameter("a", 1.0, -200.0, 200.0, prior=known),
                   Parameter("b", 1.0, -200.0, 200.0))  # fmt: skip
        problem = Problem(Linear(J), y, structure.sd, unknown)
        found = weighed(problem, structure, solved(problem), solved)
        p, problem = found.outcome.values, found.problem
        table = accuracy_table(case, structure.names, found.components)
        sized = with_accuracies(case, dict(zip(table.names, table.values, strict=True)))
        rows = [(c, r) for c, (_, r) in zip(sized.channels, rows, strict=True)]
        possible = Possible.of(table, used)
        over = None
        if possible is not None:
            problems = possible.problems(problem, possible.structure(rows))
            over = OverAccuracies.of(problems, table.odds, p, J @ p, J)
        known = assess(problem, p, J, J @ p, over)
        errors = KnownErrors(sized, problem, J @ p, J, tuple(rows), None, possible)
        computed[:, 1] = later @ p
        survey = SimpleNamespace(computed=computed, sensitivity=np.stack([J, later], axis=1))
        accuracy = np.repeat([[c.accuracy] for c in sized.channels], 2, axis=1)
        band = predict_stages(survey, known, accuracy, wanted, errors)
        held = (known.lower95 <= truth) & (truth <= known.upper95)
        bands = (band.lower95[:, 1] <= y_later) & (y_later <= band.upper95[:, 1])
        right.append([*held, bands.mean()])
        held = np.abs(truth - p) <= 1.96 * known.sd
        bands = np.abs(y_later - band.mean[:, 1]) <= 1.96 * band.sd[:, 1]
        plain.append([*held, bands.mean()])
    return np.mean(right, axis=0), np.mean(plain, axis=0)


@dataclass(frozen=True)
class CaseLike:
    channels: tuple
    stages: tuple
    readings: tuple

    def reading_at(self, channel, stage):
        return Reading(channel.name, stage, None)


def test_a_lattice_stands_for_three_accuracies_as_a_grid_does():
    rng, n, of = np.random.default_rng(3), 30, np.arange(30) % 3
    J = np.column_stack([np.ones(n), np.linspace(0.0, 1.0, n)])
    structure = ErrorStructure(
        np.ones(n), of, sp.csr_array((n, 0)), np.zeros(0, dtype=int), ("a", "b", "c")
    )
    y = J @ TRUTH + np.array([2.0, 0.5, 1.0])[of] * rng.standard_normal(n)
    likelihood = RestrictedLikelihood(structure, y, J, np.zeros(0), np.zeros((0, 2)))
    best = estimate_components(likelihood, np.zeros(3))

    def moments(points, odds):
        mean = odds @ points
        return [mean, np.sqrt(odds @ (points - mean) ** 2)]

    possible = with_possible(likelihood, best).possible
    sd = np.sqrt(np.diag(best.covariance))
    along = [t + np.linspace(-4.0, 5.0, 19) * s for t, s in zip(best.log_factor, sd, strict=True)]
    grid = np.stack(np.meshgrid(*along), axis=-1).reshape(-1, 3)
    odds = np.exp(-0.5 * np.array([likelihood.value(t) - best.minus_two_l for t in grid]))
    exact = moments(grid - best.log_factor, odds / odds.sum())
    np.testing.assert_allclose(moments(possible.points, possible.odds), exact, atol=0.05)


@pytest.mark.slow  # the textbook's interval, and the few of below
@pytest.mark.parametrize("prior", [False, True])
@pytest.mark.parametrize("sizes", [(2.0,), (2.0, 0.5)])
@pytest.mark.parametrize("n", [8, 16, 40])
def test_intervals_and_bands_hold_what_they_say(n, sizes, prior):
    """Of two kinds of four readings each, which say little of two accuracies, a little less."""
    inside, plain = coverage(n, sizes, 1000, prior=prior)
    few = n == 8 and len(sizes) == 2
    assert np.all((0.89 if few else 0.93) <= inside)
    assert np.all(inside <= 0.97)
    if n == 8:
        assert plain.min() < 0.92


@pytest.mark.slow  # counts many draws
def test_few_of_them_do():
    inside, plain = coverage(8, (2.0, 0.5), 12)
    assert inside.mean() > 0.87 > plain.mean()
