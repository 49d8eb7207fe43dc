"""Where nothing scatters, sections are one stack of readings: the same as scipy finds of it."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import least_squares
from support.sections import K0, E, Formulas, modulus_law, quiet, section

from geoident.errors import ModelError
from geoident.identify.hierarchical.knowledge import SectionsKnowledge
from geoident.identify.hierarchical.search import fit_sections
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.parameter import Parameter, Prior

GSI = (25.0, 40.0, 55.0, 60.0)
POWER = np.repeat([0.0, 1.0], 3)


def sections_with(noise):
    """Convergences by K0 / E; half of the readings depend on K0 in another way."""
    rng = np.random.default_rng(5)
    found, models = [], []
    for gsi in GSI:
        loads = np.tile(np.array([3.0, 8.0, 13.0]) * (1 + 0.2 * rng.random()), 2)
        loads[3:] *= 2.0

        def model(p, loads=loads):
            v = loads * (0.5 + p[1]) / p[0] * p[1] ** POWER
            return v, np.stack([-v / p[0], v * (1.0 / (0.5 + p[1]) + POWER / p[1])], axis=1)

        v = model(np.array([2.0 * np.exp(0.03 * gsi), 1.4]))[0]
        sd = 0.02 * v
        measured = v + noise * sd * rng.normal(size=6)
        found.append(section(f"GSI {gsi:g}", (E, K0), measured, sd, GSI=gsi))
        models.append(model)
    return found, tuple(models)


@pytest.mark.parametrize("prior", [None, Prior(1.0, 0.01)])
@pytest.mark.parametrize("sharing", [0, 2])
def test_shared_parameters_and_a_law_without_scatter_are_one_stack(sharing, prior):
    """Readings of some sections share errors; the prior of what is shared counts once."""
    sections, models = sections_with(1.0)
    columns = 0.05 * np.abs(sections[0].measured)[:, None]
    white = []
    for s, one in enumerate(sections):
        shared = SharedErrors(sp.csr_array(columns)) if s < sharing else None
        parameters = (E, replace(K0, prior=prior))
        sections[s] = replace(one, shared=shared, parameters=parameters)
        cov = np.diag(one.sd**2) + (columns @ columns.T if s < sharing else 0.0)
        white.append(np.linalg.inv(np.linalg.cholesky(cov)))

    def residuals(x):
        parts = [
            w @ (m(np.array([np.exp(x[0] + x[1] * s.covariates["GSI"]), x[2]]))[0] - s.measured)
            for s, m, w in zip(sections, models, white, strict=True)
        ]
        return np.concatenate([*parts, [] if prior is None else [(x[2] - 1.0) / 0.01]])

    fit = fit_sections(sections, ("K0",), (modulus_law("none"),), Formulas(models), quiet)
    known = least_squares(residuals, [0.0, 0.02, 1.0], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    k0, a, b = fit.outcome.values
    np.testing.assert_allclose([np.log(a), b, k0], known.x, rtol=1e-6)
    np.testing.assert_allclose(fit.outcome.objective, 2 * known.cost, rtol=1e-8)
    C = np.linalg.inv(known.jac.T @ known.jac)
    found = SectionsKnowledge(fit).common()
    np.testing.assert_allclose(found.sd, np.sqrt([C[2, 2], C[0, 0] * a**2, C[1, 1]]), rtol=1e-4)
    low = np.array([k0 - 1.96 * np.sqrt(C[2, 2]), a * np.exp(-1.96 * np.sqrt(C[0, 0]))])
    np.testing.assert_allclose(found.lower95[:2], low, rtol=1e-4)


def test_a_scatter_that_is_not_there_ends_as_the_stack():
    sections, models = sections_with(0.0)
    fit = fit_sections(sections, ("K0",), (modulus_law(),), Formulas(models), quiet)
    np.testing.assert_allclose(fit.outcome.values[-3:], [1.4, 2.0, 0.03], rtol=1e-6)
    assert fit.tau[0] == 0.0


def test_every_section_alone_where_nothing_is_common():
    sections, models = sections_with(1.0)
    fit = fit_sections(sections, (), (), Formulas(models), quiet)
    for s, (one, model) in enumerate(zip(sections, models, strict=True)):
        known = least_squares(
            lambda p, one=one, model=model: (model(p)[0] - one.measured) / one.sd,
            [5.0, 1.0], xtol=1e-15, ftol=1e-15, gtol=1e-15,
        )  # fmt: skip
        np.testing.assert_allclose(fit.outcome.values[2 * s : 2 * s + 2], known.x, rtol=1e-6)


def test_a_model_without_solution_at_the_start_is_said():
    sections, models = sections_with(1.0)

    def fails(p):
        raise ModelError("collapse")

    with pytest.raises(ModelError, match="collapse"):
        fit_sections(sections, (), (), Formulas((fails, *models[1:])), quiet)


def test_a_law_outside_the_bounds_is_said_in_the_unit_of_the_case():
    modulus = Parameter("E", 5e9, 1e9, 2e10, scale="log", dimension="pressure", unit="GPa")
    one = section("A", (modulus,), [1.0], 0.1, GSI=0.0)
    a, b = modulus_law().constants
    law = replace(modulus_law("none"), constants=(replace(a, start=5e10, upper=1e12), b))
    with pytest.raises(ModelError) as caught:
        fit_sections([one], [], [law], Formulas((lambda p: (p, np.eye(1)),)), quiet)
    assert str(caught.value) == (
        "The law of E gives 50 GPa for A, outside its bounds 1 GPa to 20 GPa."
    )
