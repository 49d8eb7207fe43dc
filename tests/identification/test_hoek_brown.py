"""GSI, mi and the strength of intact rock from readings that another mesh or solution gives.

Coverage: what is true and what is fitted are never of one model. Forty sets of noise on readings of
elements are fitted by formulas, twenty on readings of formulas by elements; of thirty projects of
six sections, whose GSI scatter about a law, readings of elements are fitted by formulas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from support.cases import displacement, make_case, model, rollers
from support.meshes import opening
from support.sections import Formulas, name, quiet, section
from support.yielding import constant, hoek, rock

from geoident.forward.model import StagedModel
from geoident.forward.openings.model import opening_model
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.hierarchical.knowledge import SectionsKnowledge
from geoident.identify.hierarchical.search import fit_sections
from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.model.case import Material, Stage
from geoident.model.empirical.rock_mass import RockMassModulus
from geoident.model.methods import (
    ClosedFormOptions,
    ComplementarityOptions,
    GaussNewtonOptions,
    MethodOptions,
)
from geoident.model.parameter import Parameter, Scalar
from geoident.model.project.formulas import LawTerm
from geoident.model.project.project import ParameterLaw, Scatter
from geoident.model.response import Response

RADIUS, FAR = 3.0, 12e6
PARTS = (0.5, 0.8, 0.95)
DEPTHS = (0.0, 1.0, 3.0, 6.0)
ACCURACY = 0.3e-3
PARAMETERS = (Parameter("GSI", 45.0, 15.0, 80.0), Parameter("sigci", 60e6, 10e6, 150e6, "log"))
TRUTH = np.array([33.0, 38e6])
METHODS = pytest.mark.parametrize(
    "method",
    [
        pytest.param(GaussNewtonOptions(), id="gauss-newton"),
        pytest.param(
            ComplementarityOptions(restarts=1, max_evaluations=30),
            id="complementarity",
            marks=pytest.mark.slow,
        ),
    ],
)


PAIRS = [(f"d{depth:g}", f"s{k}") for depth in DEPTHS for k in range(len(PARTS))]
GIVEN = {"GSI": 33.0, "sigci": 38e6, "mi": 9.0}
KNOWN = {"GSI": PARAMETERS[0], "sigci": PARAMETERS[1], "mi": Parameter("mi", 12.0, 4.0, 33.0)}


def ground(sought: Sequence[str]) -> Material:
    """Rock whose GSI says strength and stiffness; what is not sought is given."""
    number = {name: Scalar(1.0, name) if name in sought else x for name, x in GIVEN.items()}
    GSI = number["GSI"] if "GSI" in sought else Scalar(GIVEN["GSI"])
    modulus = RockMassModulus(GSI=GSI, D=Scalar(0.0), Ei=Scalar(15e9))
    sigci, mi = number["sigci"], number["mi"]
    return rock(modulus, 0.25, hoek(sigci, mi=mi, GSI=GSI, D=0.0, psi=np.radians(4.0)))


def settings(sought: Sequence[str]) -> dict[str, Any]:
    """What the tunnel is, with and without a mesh."""
    return {
        "parameters": tuple(KNOWN[name] for name in sought),
        "materials": {"rock": ground(sought)},
        "groups": {"core": "rock", "rock": "rock"},
        "in_situ": constant(*(-FAR,) * 3),
        "stages": tuple(
            Stage(f"s{k}", excavate=() if k else ("core",), release={"core": Scalar(part)})
            for k, part in enumerate(PARTS)
        ),
        "channels": tuple(
            displacement(f"d{depth:g}", (RADIUS + depth, 0.0), (1.0, 0.0)) for depth in DEPTHS
        ),
    }


def tunnel(
    n: int, layers: int, sought: Sequence[str] = ("GSI", "sigci"), reach: float = 25.0
) -> StagedModel:
    """A quarter of a round tunnel, out to some radii."""
    mesh = opening("quad8", 2, n=n, layers=layers, radius=RADIUS, reach=reach * RADIUS)
    return model(mesh, supports=rollers(2), **settings(sought))


def formulas(sought: Sequence[str]) -> Response:
    """The same without a mesh."""
    case = make_case(opening("quad8", 2, n=1, layers=1, radius=RADIUS, reach=2 * RADIUS))
    fit = replace(case.fit, closed_form=ClosedFormOptions((0.0, 0.0), RADIUS))
    changes = settings(sought) | {"mesh_file": None, "fit": fit}
    return opening_model(replace(case, **changes)).response(PAIRS)


@cache
def of_a_finer_mesh() -> np.ndarray:
    """Readings (g,) at the truth, without noise."""
    return tunnel(3, 40).response(PAIRS).readings(TRUTH)


@METHODS
def test_truth_lies_in_the_intervals(method: MethodOptions):
    measured = of_a_finer_mesh()
    measured = measured + ACCURACY * np.random.default_rng(7).standard_normal(len(measured))
    response = tunnel(2, 24).response(PAIRS)
    problem = Problem(response, measured, np.full(len(measured), ACCURACY), PARAMETERS)
    outcome = identify(problem, (method,), lambda iteration: None)
    assert outcome.status == "converged"
    known = assess(problem, outcome.values, response.evaluate(outcome.values)[1])
    assert known.determined.all()
    assert np.all(known.lower95 <= TRUTH)
    assert np.all(known.upper95 >= TRUTH)
    assert np.all(known.upper95 - known.lower95 < 0.3 * TRUTH)
    assert response.activity(outcome.values).points.max() > 5


# --- coverage ---

NOISE = 0.5e-3
"""m; the meshes below err by half of it at most."""

SOUGHT = pytest.mark.parametrize("sought", [("GSI", "sigci"), ("GSI", "mi")])


def share_held(
    response: Response, clean: np.ndarray, sought: Sequence[str], repetitions: int
) -> tuple[np.ndarray, np.ndarray]:
    """Share of the intervals that hold the truth, and spread of the errors by what is stated."""
    truth = np.array([GIVEN[name] for name in sought])
    unknown = tuple(KNOWN[name] for name in sought)
    held, errors = [], []
    for seed in range(repetitions):
        measured = clean + NOISE * np.random.default_rng(seed).standard_normal(len(clean))
        problem = Problem(response, measured, np.full(len(measured), NOISE), unknown)
        outcome = identify(problem, (GaussNewtonOptions(),), lambda iteration: None)
        assert outcome.status == "converged"
        known = assess(problem, outcome.values, response.evaluate(outcome.values)[1])
        held.append((known.lower95 <= truth) & (truth <= known.upper95))
        half = 0.5 * (known.upper95 - known.lower95) / 1.96
        errors.append((outcome.values - truth) / half)
    return np.mean(held, axis=0), np.std(errors, axis=0)


@pytest.mark.slow
@SOUGHT
def test_intervals_by_formulas_hold_the_truth_of_elements(sought):
    clean = tunnel(2, 50, (), 50.0).response(PAIRS).readings(np.empty(0))
    held, spread = share_held(formulas(sought), clean, sought, 40)
    assert np.all(held >= 0.85)  # 34 of 40: 1.4 % of all sets have fewer at 95 %
    assert np.all((spread > 0.7) & (spread < 1.3))


@pytest.mark.slow
@SOUGHT
def test_intervals_by_elements_hold_the_truth_of_formulas(sought):
    clean = formulas(()).readings(np.empty(0))
    response = tunnel(1, 24, sought, 50.0).response(PAIRS)
    held, spread = share_held(response, clean, sought, 20)
    assert np.all(held >= 0.8)  # 16 of 20: 0.3 % of all sets have fewer at 95 %
    assert np.all((spread > 0.6) & (spread < 1.4))


# --- several sections, GSI by a law ---

TRUE = {"mi": 9.0, "shift": -3.0, "tau": 4.0}
WITH_LAW = ParameterLaw(
    "GSI", "shift + mapped", LawTerm("+", (name("shift"), name("mapped"))),
    (Parameter("shift", 0.0, -20.0, 20.0),), Scatter("estimate", 0.0),
)  # fmt: skip


def moved_by_gsi() -> CubicSpline:
    """Logarithms of the inward motions of elements: analyses at GSI from 12 to 64, between them.

    Poor rock is known to 0.03 of GSI: the mesh is that large, and errs by 0.1 mm there. One of 50
    radii errs by 0.5 mm, and its intervals hold 89 % of the sections.
    """
    response = tunnel(1, 60, ("GSI",), 200.0).response(PAIRS)
    at = np.arange(12.0, 65.0, 4.0)
    return CubicSpline(at, np.log([-response.readings(np.array([gsi])) for gsi in at]))


def repetition(seed: int, moved: CubicSpline, response: Response) -> dict[str, list[bool]]:
    """Whether the intervals of six sections and of two that are left out hold what is true."""
    rng = np.random.default_rng(seed)
    mapped = rng.uniform(28.0, 50.0, 8)
    GSI = mapped + TRUE["shift"] + TRUE["tau"] * np.clip(rng.normal(size=8), -3.0, 3.0)
    unknown = (KNOWN["GSI"], KNOWN["mi"])
    sections = [
        section(
            f"km {s}", unknown,
            -np.exp(moved(GSI[s])) + NOISE * rng.standard_normal(len(PAIRS)), NOISE,
            mapped=float(mapped[s]),
        )
        for s in range(8)
    ]  # fmt: skip
    models = Formulas((response.evaluate,) * 6)
    found = fit_sections(sections[:6], ("mi",), (WITH_LAW,), models, quiet)
    assert found.outcome.status == "converged"
    known = SectionsKnowledge(found)
    common = known.common()
    ends = zip(common.lower95, common.upper95, strict=True)
    held = {
        key: [bool(low <= TRUE[key] <= high)]
        for key, (low, high) in zip(("mi", "shift"), ends, strict=True)
    }
    low, high = (end * found.joint.law_scaling.reference[0] for end in known.scatter.interval(0))
    held["tau"] = [bool(low <= TRUE["tau"] <= high)]
    each = [known.section(s) for s in range(6)]
    held["sections"] = [
        bool(one.lower95[0] <= gsi <= one.upper95[0])
        for one, gsi in zip(each, GSI[:6], strict=True)
    ]
    further = [known.further(one).interval for one in sections[6:]]
    held["left out"] = [
        bool(one.lower95[0] <= gsi <= one.upper95[0])
        for one, gsi in zip(further, GSI[6:], strict=True)
    ]
    return held


@pytest.mark.slow
def test_intervals_of_sections_with_a_law_of_gsi_hold_the_truth_of_elements():
    moved, response = moved_by_gsi(), formulas(("GSI", "mi"))
    found = [repetition(seed, moved, response) for seed in range(30)]
    share = {key: float(np.mean([flag for one in found for flag in one[key]])) for key in found[0]}
    for key in ("mi", "shift", "tau"):
        assert share[key] >= 0.83, share  # 25 of 30: 1.6 % of all sets have fewer at 95 %
    assert share["sections"] >= 0.9, share
    assert share["left out"] >= 0.85, share
