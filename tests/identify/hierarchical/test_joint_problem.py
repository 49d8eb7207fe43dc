"""Which unknown is which parameter of which section, and how all readings follow from them."""

from dataclasses import replace

import numpy as np
import pytest
from support.three_sections import FURTHER, LARGEST, ORDERS, SCALE, Site

from geoident.errors import ModelError
from geoident.model.parameter import Parameter

SCATTERING = [(True, True), (True, False), (False, True), (False, False)]


@pytest.fixture(scope="module", params=SCATTERING, ids=str)
def site(request):
    return Site(request.param)


def readings_of(site, values):
    """All readings, then the gaps of scattering laws, section by section, from their formulas."""
    by_name = dict(zip([q.name for q in site.joint.unknowns], values, strict=True))
    K0, a, b, m, n = values[:5]
    parts, gaps = [], []
    for s, (section, order) in enumerate(zip(site.sections, ORDERS, strict=True)):
        law = {
            "E": a * np.exp(b * section.covariates["GSI"]),
            "h": m + n * section.covariates["D"],
            "K0": K0,
        }
        p = [by_name.get(f"{q.name} of S{s}", law.get(q.name)) for q in order]
        parts.append(site.matrices[s] @ np.abs(np.array(p)) ** 1.3)
        for q, z in zip(order, p, strict=True):
            if q.name == "E" and site.joint.scattering[0]:
                gaps.append(np.log(z / law["E"]))
            if q.name == "h" and site.joint.scattering[1]:
                gaps.append((z - law["h"]) / SCALE["h"])
    return np.concatenate([*parts, gaps])


def test_unknowns_are_what_is_common_and_what_is_of_each_section(site):
    joint = site.joint
    held = {"K0"} | {n for n, more in zip("Eh", joint.scattering, strict=True) if not more}
    own = [f"{q.name} of S{s}" for s, order in enumerate(ORDERS) for q in order
           if q.name not in held]  # fmt: skip
    assert [q.name for q in joint.unknowns] == ["K0", "a", "b", "m", "n", *own]
    known = {q.name: q for q in joint.unknowns}
    assert known["K0"].prior == ORDERS[0][1].prior
    assert known["nu of S2"].prior == ORDERS[0][2].prior
    assert all(known[n].prior is None for n in known if n[:2] in ("E ", "h "))  # of the law
    np.testing.assert_allclose(joint.largest, LARGEST)


def test_all_readings_and_rows_of_laws_with_their_derivatives(site):
    problem = site.joint.problem(site.models, np.array([0.3, 0.07]))
    response = problem.response
    v, J = response.evaluate(site.values)
    np.testing.assert_allclose(v, readings_of(site, site.values), rtol=1e-10)
    assert J.shape == (len(v), len(site.values))
    for j, step in enumerate(1e-6 * np.maximum(np.abs(site.values), 1e-2)):
        unit = step * np.eye(len(site.values))[j]
        slope = readings_of(site, site.values + unit) - readings_of(site, site.values - unit)
        np.testing.assert_allclose(J[:, j], slope / (2.0 * step), rtol=2e-5, atol=1e-5)
    assert response.admissible(site.values) is None
    # readings with their own errors, then the laws with their scatter
    g = sum(len(section.sd) for section in site.sections)
    np.testing.assert_array_equal(problem.sd[:g], np.concatenate([q.sd for q in site.sections]))
    scatter = dict(zip("Eh", (0.3, 0.07), strict=True))
    held = {n for n, more in zip("Eh", site.joint.scattering, strict=True) if not more}
    expected = [scatter[q.name] for order in ORDERS for q in order if q.name in set("Eh") - held]
    np.testing.assert_array_equal(problem.sd[g:], expected)


@pytest.mark.parametrize(("value", "inside"), [(0.9999999999995, True), (1.0000000000015, False)])
def test_a_law_may_end_on_a_bound_up_to_rounding(value, inside):
    """E = a exp(b GSI) is 500 at its upper bound, 0.05 at its lower one."""
    joint = Site((False, False)).joint
    for end, off in ((500.0, value), (0.05, 2.0 - value)):
        values = np.array([1.35, end * off, 0.0, 3.0, 0.6, 0.2, 0.2, 2.0])[: len(joint.unknowns)]
        if inside:
            assert joint.point(0, values)[0][0] == pytest.approx(end)
        else:
            with pytest.raises(ModelError, match=r"outside its bounds 0\.05 to 500"):
                joint.point(0, values)


def test_what_is_outside_its_domain_is_said():
    site = Site((False, False))
    response = site.joint.problem(site.models, np.zeros(2)).response
    for a, said in ((-2.0, "-2"), (np.nan, "nan"), (0.0, "0")):
        beyond = site.values.copy()
        beyond[1:3] = a, 0.0
        expected = f"The law of E gives {said}, outside its admissible range."
        assert response.admissible(beyond) == expected


def test_parameters_to_be_expected_keep_to_their_bounds(site):
    own = (
        Parameter("nu", 0.3, 0.05, 0.45),
        replace(ORDERS[0][2], upper=0.21),
        replace(ORDERS[0][2], lower=0.23),
    )
    section = replace(site.sections[0], parameters=own)
    assert site.joint.expected_point(section, site.values).tolist() == [0.3, 0.21, 0.23]
    deep = replace(FURTHER, covariates={"GSI": 400.0, "D": -200.0})
    assert site.joint.expected_point(deep, site.values)[[0, 3]].tolist() == [-40.0, 500.0]
