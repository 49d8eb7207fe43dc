"""All unknowns at once by a nonlinear program: the same answers as the implicit method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from support.array_model import ArrayModel
from support.cases import displacement
from support.footings import TRUTH, two_layers
from support.yield_sites import deep_opening, task
from support.yielding import Cavity, constant, mohr, rock

from geoident.errors import InputError
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem import methods
from geoident.identify.problem.methods import identify
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.identify.yield_limits.full_space import full_space
from geoident.identify.yield_limits.implicit import certificate_at, implicit
from geoident.model.methods import (
    ComplementarityOptions,
    GaussNewtonOptions,
    HuberOptions,
    LossOptions,
    SquaredOptions,
    StudentOptions,
)
from geoident.model.parameter import Parameter, Prior, Scalar
from geoident.model.results.result import Iteration

FULL = ComplementarityOptions(formulation="full-space")


def silent(entry: Iteration) -> str | None:
    return None


def lined_opening(**strength: object):
    """A tunnel dug in two stages, then lined; E, the far stress and the cohesion unknown."""
    cavity = Cavity()
    mesh = cavity.mesh("quad4", n=3, layers=5, reach=6.0)
    p = [Scalar(-1.0, "stress")] * 3
    return cavity.staged(
        mesh,
        materials={
            "rock": rock(Scalar(1.0, "E"), 0.2, mohr(Scalar(1.0, "c"), 0.5, planes=12, **strength))
        },
        in_situ=constant(*p),
        parameters=(
            Parameter("E", 6e9, 1e9, 5e10, "log"),
            Parameter("stress", 2e7, 1e7, 4e7),
            Parameter("c", 3e6, 1e6, 2e7),
        ),
        channels=(
            displacement("wall", (1.0, 0.0), (1.0, 0.0)),
            displacement("rock", (2.0, 0.5), (1.0, 0.0)),
        ),
    )


@pytest.fixture(scope="module")
def responses():
    """Stage by stage with excavation, free moduli, stresses and strengths; parameters for each."""
    opening = deep_opening(2, elements=200)
    return (
        (
            lined_opening().response([("wall", "open"), ("rock", "open")]),
            np.array([5e9, 1.5e7, 2e6]),
        ),
        (opening.model.response(opening.pairs), np.array([0.8e7, 1.1e7])),
    )


def test_the_exported_arrays_answer_as_the_march(responses) -> None:
    for response, p in responses:
        assert response.system_obstacle() is None
        v, jacobian = response.evaluate(p)
        arrays = ArrayModel(response.equation_arrays())
        found, slopes = arrays.evaluate(p)
        assert found == pytest.approx(v, rel=1e-9, abs=1e-12)
        assert slopes == pytest.approx(jacobian, rel=1e-7, abs=1e-7 * np.abs(jacobian).max())
        assert any(steps.any() for _, _, laws in arrays.analysis(p) for steps in laws.values())


def test_the_bilinear_system_holds_at_what_the_march_finds(responses) -> None:
    """Equations, complementary slacks and readings, at other parameters than it was made at."""
    for response, p in responses:
        staged, system = response.equation_arrays(), response.system()
        kinds = system.kind_of_unknown
        np.testing.assert_array_equal(np.flatnonzero(kinds < 0), np.sort(system.multipliers))
        arrays = ArrayModel(staged)
        x: list[np.ndarray] = []
        for stage, (du, borne, steps) in zip(staged.stages, arrays.analysis(p), strict=True):
            x.append(du[stage.dofs, 0])
            for s in stage.laws:
                x += [borne.stress[:, arrays.places[s], 0].ravel(), steps[s].ravel()]
        found = np.concatenate(x)
        vector, matrix = system.equations.at(p)
        terms = np.abs(vector) + abs(matrix) @ np.abs(found)
        assert np.abs(vector + matrix @ found).max() < 1e-9 * terms.max()
        stresses = system.kind_of_equation > 0
        assert np.all(np.abs(vector + matrix @ found)[stresses] < 1e-9 * terms[stresses].max())
        vector, matrix = system.slacks.at(p)
        slack, lam = vector + matrix @ found, found[system.multipliers]
        assert slack.min() > -1e-9 * np.abs(vector).max()
        assert lam.min() >= 0.0
        assert np.all((lam == 0.0) | (np.abs(slack) < 1e-9 * np.abs(vector).max()))
        assert np.any(lam > 0.0)
        assert np.any(slack > 1e-3 * np.abs(vector).max())
        vector, matrix = system.readings.at(p)
        assert vector + matrix @ found == pytest.approx(response.readings(p), rel=1e-8)


def test_what_turns_planes_is_refused_by_name() -> None:
    cavity = Cavity()
    mesh = cavity.mesh("quad4", n=2, layers=3, reach=6.0)
    turning = mohr(3e6, Scalar(1.0, "phi"), planes=12)
    gauge = displacement("wall", (1.0, 0.0), (1.0, 0.0))
    phi = (Parameter("phi", 0.5, 0.1, 0.9),)
    staged = cavity.staged(
        mesh, materials={"rock": rock(6e9, 0.2, turning)}, parameters=phi, channels=(gauge,)
    )
    response = staged.response([("wall", "open")])
    assert "phi turns the yield planes of rock" in (response.system_obstacle() or "")
    problem = Problem(response, np.array([-0.01]), np.array([1e-3]), phi)
    with pytest.raises(InputError, match="phi turns the yield planes"):
        identify(problem, (FULL,), silent)


def test_a_smooth_surface_is_refused() -> None:
    response = Cavity().staged(
        Cavity().mesh("quad4", n=2, layers=3, reach=6.0),
        mohr(Scalar(1.0, "c"), 0.5),
        parameters=(Parameter("c", 3e6, 1e6, 2e7),),
        channels=(displacement("wall", (1.0, 0.0), (1.0, 0.0)),),
    )
    why = response.response([("wall", "open")]).system_obstacle()
    assert "exact surface" in (why or "")


def test_a_missing_package_is_refused_before_computing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(methods, "find_spec", lambda name: None)
    problem = two_layers((3, 2), (4.5,), start=(1.2, 1.2))
    with pytest.raises(InputError, match=r"install \"geoident\[full-space\]\""):
        identify(problem, (FULL,), silent)
    assert problem.response.counts.evaluations == 1  # that of the readings


@pytest.mark.slow  # without noise: the next
def test_noise_gives_the_same_optimum_as_the_implicit_method(
    capfd: pytest.CaptureFixture[str],
) -> None:
    problem = two_layers((3, 2), (4.5, 4.8), start=(1.3, 1.4))
    searched = implicit(problem, ComplementarityOptions(restarts=10), silent)
    found = full_space(problem, FULL, silent)
    assert found.status == "converged"
    assert found.objective == pytest.approx(searched.objective, rel=1e-3)
    assert found.objective == Discrepancy(problem).objective(found.values)
    assert "complementarity to 1e-12, and the model confirms" in found.reason
    assert found.certificate is not None
    assert searched.certificate is not None
    assert found.certificate.kind == searched.certificate.kind == "strongly stationary"
    again = certificate_at(problem, found.values, History("again", problem.response, silent))
    assert repr(found.certificate) == repr(again)
    assert capfd.readouterr() == ("", "")


def test_where_gauss_newton_ends_in_a_poor_minimum_the_truth_is_found() -> None:
    problem = two_layers((4, 3), (4.5,), start=(1.0, 1.5), seed=None)
    assert gauss_newton(problem, GaussNewtonOptions(), silent).objective > 10.0
    found = full_space(problem, FULL, silent)
    assert found.values == pytest.approx(TRUTH, rel=1e-5)


def test_losses_and_priors_are_those_of_the_discrepancy() -> None:
    """The program's own objective at its end is the discrepancy of the model there."""
    given = two_layers((4, 3), (4.5,), start=(1.2, 1.3))
    normal, log = Prior(1.2, 0.2), Prior(1.0, 0.3, "lognormal")
    parameters = tuple(
        replace(q, prior=prior) for q, prior in zip(given.parameters, (normal, log), strict=True)
    )
    problem = replace(given, parameters=parameters, loss=StudentOptions(3.0))
    history: list[Iteration] = []
    found = full_space(problem, FULL, history.append)  # type: ignore[arg-type]
    last = [entry for entry in history if entry.note.startswith("smoothing")][-1]
    assert last.objective == pytest.approx(found.objective, rel=1e-6)
    assert found.status == "converged"


@pytest.mark.parametrize("loss", [SquaredOptions(), StudentOptions(3.0), HuberOptions()])
def test_the_program_knows_what_readings_share_as_phi_does(loss: LossOptions) -> None:
    given = two_layers((3, 2), (4.5,), start=(1.2, 1.3))
    numbers = np.arange(len(given.measured))
    columns = given.sd[:, None] * np.stack([np.full(len(numbers), 2.0), numbers % 2], axis=1)
    wrong = given.measured + np.where(numbers == 1, 9.0, 0.0) * given.sd
    shared = SharedErrors(sp.csr_array(columns))
    problem = replace(given, measured=wrong, shared=shared, loss=loss)
    history: list[Iteration] = []
    found = full_space(problem, FULL, history.append)  # type: ignore[arg-type]
    last = [entry for entry in history if entry.note.startswith("smoothing")][-1]
    assert last.objective == pytest.approx(found.objective, rel=1e-6)
    assert found.objective == pytest.approx(Discrepancy(problem).objective(found.values))
    assert found.status == "converged"


def test_a_program_that_is_not_solved_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geoident.identify.yield_limits.full_space._MOST_STEPS", 1)
    found = full_space(two_layers((3, 2), (4.5,), start=(1.2, 1.3)), FULL, silent)
    assert found.status == "not-converged"
    assert "was not solved (Maximum_Iterations_Exceeded): use the formulation" in found.reason


@pytest.mark.parametrize(("part", "agree"), [(0.9995, True), (0.99, False)])
def test_the_model_must_confirm_the_discrepancy_of_the_program(part: float, agree: bool) -> None:
    """All that is read is zero; the model answers with a part of what the program computes."""
    problem = two_layers((3, 2), (4.5,), start=(1.2, 1.3), seed=None)
    off = replace(problem, measured=np.zeros_like(problem.measured))
    model = off.response
    plain = model.readings
    model.readings = lambda p: part**0.5 * plain(p)  # type: ignore[method-assign]
    found = full_space(off, FULL, silent)
    assert (found.status == "converged") == agree
    assert agree or "The model gives a misfit of" in found.reason


def test_the_observer_ends_it_with_the_best_point_so_far() -> None:
    problem = two_layers((4, 3), (4.5,), start=(1.2, 1.3))
    found = full_space(problem, FULL, lambda entry: "enough" if entry.number >= 12 else None)
    assert (found.status, found.reason) == ("out-of-budget", "enough")
    assert found.objective == Discrepancy(problem).objective(found.values)
    assert len(found.iterations) < 30


def test_an_exception_of_the_observer_gets_out() -> None:
    def impatient(entry: Iteration) -> str | None:
        if entry.number > 5:
            raise KeyboardInterrupt
        return None

    with pytest.raises(KeyboardInterrupt):
        full_space(two_layers((3, 2), (4.5,), start=(1.2, 1.3)), FULL, impatient)


@pytest.mark.slow
def test_five_hundred_elements_agree_with_the_implicit_method() -> None:
    given = task(deep_opening(2), 1, noise=1.0).problem
    searched = implicit(given, ComplementarityOptions(), silent)
    found = full_space(given, FULL, silent)
    assert found.objective == pytest.approx(searched.objective, rel=1e-3)
