"""Where nothing scatters, sections are one stack of readings: the same as scipy finds of it."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import least_squares
from support.sections import K0, E, Formulas, convergences, modulus_law, quiet, section

from geoident.errors import ModelError
from geoident.identify.hierarchical.joint_problem import JointUnknowns
from geoident.identify.hierarchical.knowledge import SectionsKnowledge
from geoident.identify.hierarchical.search import fit_sections
from geoident.identify.problem.errors import SharedErrors
from geoident.model.parameter import Parameter, Prior

LOADS = np.array([3.0, 8.0, 13.0])
GSI = (25.0, 40.0, 55.0, 60.0)


def sections_with(noise, *, only_E=False):
    rng = np.random.default_rng(5)
    found, models = [], []
    for gsi in GSI:
        loads = LOADS * (1 + 0.2 * rng.random())
        # the second reading of each section depends on K0 in another way
        model = convergences(np.stack([loads, 2 * loads]).ravel())
        power = np.repeat([0.0, 1.0], 3)

        def responses(p, model=model, power=power):
            v, J = model(p)
            more = p[1] ** power
            by = np.zeros_like(J)
            by[:, 1] = v * power * p[1] ** (power - 1)
            return v * more, J * more[:, None] + by

        v = responses(np.array([2.0 * np.exp(0.03 * gsi), 1.4]))[0]
        sd = 0.02 * v
        found.append(
            section(f"GSI {gsi:g}", (E, K0), v + noise * sd * rng.normal(size=6), sd, GSI=gsi)
        )
        models.append(responses)
    return found, tuple(models)


def stacked(sections, models, whiten=None):
    def residuals(x):
        a, b, k0 = np.exp(x[0]), x[1], x[2]
        parts = []
        for s, (one, model) in enumerate(zip(sections, models, strict=True)):
            left = model(np.array([a * np.exp(b * one.covariates["GSI"]), k0]))[0] - one.measured
            parts.append(left / one.sd if whiten is None else whiten[s] @ left)
        return np.concatenate(parts)

    return least_squares(residuals, [0.0, 0.02, 1.0], xtol=1e-15, ftol=1e-15, gtol=1e-15)


def test_shared_parameters_and_a_law_without_scatter_are_one_stack():
    sections, models = sections_with(1.0)
    fit = fit_sections(sections, ("K0",), (modulus_law("none"),), Formulas(models), quiet)
    known = stacked(sections, models)
    k0, a, b = fit.outcome.values
    np.testing.assert_allclose([np.log(a), b, k0], known.x, rtol=1e-6)
    np.testing.assert_allclose(fit.outcome.objective, 2 * known.cost, rtol=1e-8)
    C = np.linalg.inv(known.jac.T @ known.jac)
    found = SectionsKnowledge(fit).common()
    np.testing.assert_allclose(found.sd, np.sqrt([C[2, 2], C[0, 0] * a**2, C[1, 1]]), rtol=1e-4)
    low = np.array([k0 - 1.96 * np.sqrt(C[2, 2]), a * np.exp(-1.96 * np.sqrt(C[0, 0]))])
    np.testing.assert_allclose(found.lower95[:2], low, rtol=1e-4)


def test_errors_that_readings_of_a_section_share_are_counted_once():
    sections, models = sections_with(1.0)
    columns = 0.05 * np.abs(sections[0].measured)[:, None]
    white = []
    for s, one in enumerate(sections):
        shared = SharedErrors(sp.csr_array(columns)) if s < 2 else None
        sections[s] = type(one)(
            one.name, one.parameters, one.covariates, one.measured, one.sd, shared
        )
        cov = np.diag(one.sd**2) + (columns @ columns.T if s < 2 else 0.0)
        white.append(np.linalg.inv(np.linalg.cholesky(cov)))
    fit = fit_sections(sections, ("K0",), (modulus_law("none"),), Formulas(models), quiet)
    known = stacked(sections, models, white)
    k0, a, b = fit.outcome.values
    np.testing.assert_allclose([np.log(a), b, k0], known.x, rtol=1e-6)


def test_a_scatter_that_is_not_there_ends_as_the_stack():
    sections, models = sections_with(0.0)
    fit = fit_sections(sections, ("K0",), (modulus_law(),), Formulas(models), quiet)
    np.testing.assert_allclose(fit.outcome.values[-3:], [1.4, 2.0, 0.03], rtol=1e-6)
    assert fit.tau[0] == 0.0


def test_the_prior_of_a_shared_parameter_counts_once():
    sections, models = sections_with(1.0)
    k0 = Prior(1.0, 0.01)
    sections = [
        type(one)(
            one.name,
            (E, type(K0)(**{**vars(K0), "prior": k0})),
            one.covariates,
            one.measured,
            one.sd,
        )
        for one in sections
    ]
    fit = fit_sections(sections, ("K0",), (modulus_law("none"),), Formulas(models), quiet)

    def residuals(x):
        parts = [
            (m(np.array([np.exp(x[0] + x[1] * s.covariates["GSI"]), x[2]]))[0] - s.measured) / s.sd
            for s, m in zip(sections, models, strict=True)
        ]
        return np.concatenate([*parts, [(x[2] - 1.0) / 0.01]])

    known = least_squares(residuals, [0.0, 0.02, 1.0], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    np.testing.assert_allclose(fit.outcome.values[0], known.x[2], rtol=1e-6)
    C = np.linalg.inv(known.jac.T @ known.jac)
    np.testing.assert_allclose(SectionsKnowledge(fit).common().sd[0], np.sqrt(C[2, 2]), rtol=1e-4)


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
    made = JointUnknowns([one], [], [modulus_law("none")], np.array([False]))
    with pytest.raises(ModelError) as caught:
        made.point(0, np.array([5e10, 0.02]))
    assert str(caught.value) == (
        "The law of E gives 50 GPa for A, outside its bounds 1 GPa to 20 GPa."
    )
