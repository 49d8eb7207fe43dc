"""Parameters drawn: on their scales, in pairs with ellipses, and scans without false islands."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.path import Path
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import label
from scipy.stats import chi2, norm

from geoident.model.parameter import Prior
from geoident.model.results.result import Grid
from geoident.model.results.rivals import Rivals
from geoident.report.drawing.parameters.corner import (
    corner_figure,
    draws_density,
    ellipse,
    pair_figure,
    pair_pictures,
)
from geoident.report.drawing.parameters.intervals import parameter_figure
from geoident.report.drawing.parameters.scan import region, region_levels, scan_figure
from tests.support.pictures import laid_out
from tests.support.results import example_result, parameters

E = np.geomspace(2e9, 80e9, 21)
SIGMA = np.linspace(2e6, 20e6, 21)


def ridge(E, sigma, *, accuracy=0.01):
    """Twenty readings of sigma / E to 1 %, and priors that hold the two on their ridge."""
    ratio = (sigma / E) / (8e6 / 14e9)
    prior = (np.log(E / 14e9) / 0.18) ** 2 + ((sigma - 8e6) / 8e5) ** 2
    return 20.0 * ((ratio - 1.0) / accuracy) ** 2 + prior + 3.0


def grid(*, hole=False):
    phi = ridge(*np.meshgrid(E, SIGMA, indexing="ij"))
    if hole:
        phi[:3, :3] = np.inf
    return Grid(("E_rock", "sigma_v"), (E, SIGMA), phi)


@pytest.mark.parametrize("hole", [False, True])
def test_a_ridge_narrower_than_the_grid_is_one_region(hole):
    """E and sigma_v are tied to 1 % on a grid of steps of 20 %."""
    found = region(grid(hole=hole), {"E_rock"})
    for level in region_levels(2):
        assert label(found.rise < level, np.ones((3, 3)))[1] == 1
    exact = ridge(*found.at)
    inside = exact - exact.min() < region_levels(2)[1]
    np.testing.assert_allclose(found.rise[inside], (exact - exact.min())[inside], atol=0.1)
    values, rise = found.profile(0)
    ends = values[rise < chi2.ppf(0.95, 1)][[0, -1]]
    # by the priors, of which readings leave the sum: sd of log E is 0.0873 around 8.2 / 14.4
    many = np.geomspace(10e9, 20e9, 401)
    fine = np.array([ridge(e, e * 8e6 / 14e9 * np.linspace(0.97, 1.03, 1001)).min() for e in many])
    np.testing.assert_allclose(
        ends, many[fine - fine.min() < chi2.ppf(0.95, 1)][[0, -1]], rtol=0.01
    )


def test_levels_are_those_of_chi_squared():
    for count in (1, 2):
        assert region_levels(count) == pytest.approx(chi2.ppf([0.68, 0.95], count), rel=1e-6)


def test_a_scan_is_drawn_on_the_scales_of_its_parameters():
    figure = laid_out(lambda: scan_figure(parameters(), grid(), {"E_rock"}))
    one = Grid(("E_rock",), (E,), grid().objective[:, 8])
    line = laid_out(lambda: scan_figure(parameters(), one, {"E_rock"}))
    whole = next(axes for axes in figure.axes if axes.get_ylabel() == "sigma_v (MPa)")
    assert (whole.get_xscale(), whole.get_yscale()) == ("log", "linear")
    assert whole.get_xlim() == pytest.approx((2.0, 80.0))
    assert whole.get_xlabel() == "E_rock (GPa)"
    assert line.axes[0].get_xscale() == "log"
    assert line.axes[0].get_xlabel() == "E_rock (GPa)"


def test_an_interval_is_drawn_on_the_scale_of_its_parameter_with_prior_bounds_and_numbers():
    figure = laid_out(lambda: parameter_figure([("estimate", parameters())], {"E_rock"}))
    rock, stress, ratio = figure.axes
    assert [axes.get_xscale() for axes in figure.axes] == ["log", "linear", "linear"]
    for axes, low, high in ((rock, 2.0, 80.0), (stress, 2.0, 20.0), (ratio, 0.3, 3.0)):
        first, last = axes.get_xlim()
        assert first < low < high < last
    assert "12.3 (11.6 to 13.1)" in {text.get_text() for text in rock.texts}
    (prior,) = [patch for patch in rock.patches if patch.get_alpha() == 0.35]
    ends = prior.get_extents().transformed(rock.transData.inverted())
    assert np.sqrt(ends.x0 * ends.x1) == pytest.approx(14.0, rel=1e-6)  # its median
    (start,) = [line for line in rock.get_lines() if line.get_marker() == "|"]
    assert start.get_xdata()[0] == pytest.approx(parameters().start[0] / 1e9)
    names = {text.get_text() for text in figure.legends[0].get_texts()}
    assert names == {"estimate, 95 %", "prior, 95 %", "start", "bound"}


def correlated():
    """E_rock (logarithm) and K0 known with a correlation of 0.9."""
    table = parameters()
    sd = np.array([4e8, 1.0, 0.1])
    correlation = np.array([[1.0, np.nan, 0.9], [np.nan, np.nan, np.nan], [0.9, np.nan, 1.0]])
    covariance = correlation * np.outer(sd, sd)
    values = np.array([1.234e10, 6.5e6, 1.5])
    table = replace(table, values=values, covariance=covariance, correlation=correlation)
    case = "parameters: {E_rock: {scale: log}, K0: {start: 1}}"
    return replace(example_result(2), parameters=table, case_resolved=case)


def test_an_ellipse_holds_its_share():
    covariance = np.array([[4.0, 1.8], [1.8, 1.0]])
    border = ellipse(np.array([1.0, 2.0]), covariance, 0.95)
    off = border - np.array([[1.0], [2.0]])
    distance = np.einsum("ik,ij,jk->k", off, np.linalg.inv(covariance), off)
    np.testing.assert_allclose(distance, chi2.ppf(0.95, 2), rtol=1e-12)


def test_pairs_have_the_ellipse_of_their_covariance_on_their_scales():
    result = correlated()
    (picture,) = pair_pictures(result)
    assert picture.name == "pairs"
    figure = laid_out(lambda: pair_figure(result))
    (panel,) = [axes for axes in figure.axes if axes.get_ylabel() == "K0" and axes.get_visible()]
    assert (panel.get_xscale(), panel.get_yscale()) == ("log", "linear")
    outer = next(line for line in panel.get_lines() if len(line.get_xdata()) == 181)
    x, y = np.log(outer.get_xdata()), outer.get_ydata()
    reach = np.sqrt(chi2.ppf(0.95, 2))
    assert np.ptp(x) / 2 == pytest.approx(reach * 4e8 / 1.234e10, rel=1e-3)
    assert np.ptp(y) / 2 == pytest.approx(reach * 0.1, rel=1e-3)
    assert np.corrcoef(x[:-1], y[:-1])[0, 1] == pytest.approx(0.9, abs=1e-3)
    low, high = panel.get_ylim()
    assert 0.3 <= low < 1.5 < high <= 3.0  # not beyond the bounds
    alone = replace(result, parameters=parameters().picked(np.array([0])))
    assert pair_pictures(alone) == ()


def test_other_minima_are_crosses_at_their_values_in_the_units_of_the_axes():
    values = np.array([correlated().parameters.values, [1.3e10, 6.5e6, 1.4]])
    rivals = Rivals(values, np.ones(2), np.full(2, 0.5), np.zeros((2, 3, 3)))
    figure = laid_out(lambda: pair_figure(replace(correlated(), rivals=rivals)))
    (panel,) = [one for one in figure.axes if one.get_ylabel() == "K0" and one.get_visible()]
    (cross,) = [line for line in panel.get_lines() if line.get_marker() == "x"]
    np.testing.assert_allclose(cross.get_xydata(), [[13.0, 1.4]])


def test_densities_on_the_diagonal_are_those_of_estimate_and_prior():
    """Normal ones, by their largest value; of what is found on the logarithm, in that."""
    figure = laid_out(lambda: pair_figure(correlated()))
    rock = next(axes for axes in figure.axes if axes.get_visible())
    density, prior = (line for line in rock.get_lines() if len(line.get_xdata()) == 301)
    mean, sd = np.log(12.34), 4e8 / 1.234e10
    x, height = np.log(density.get_xdata()), density.get_ydata()
    np.testing.assert_allclose(height, norm.pdf(x, mean, sd) / norm.pdf(mean, mean, sd), atol=1e-9)
    before = parameters().priors[0]
    wide = before.sd / before.mean
    np.testing.assert_allclose(
        prior.get_ydata(), np.sqrt(2 * np.pi) * wide * norm.pdf(x, np.log(14.0), wide), atol=1e-9
    )
    assert np.sum(height > 0.01) > 100  # and it is seen
    ends = sorted(
        float(line.get_xdata()[0])
        for line in rock.get_lines()
        if line.get_linestyle() == ":" and len(line.get_xdata()) == 2
    )
    assert ends == pytest.approx([11.6, 13.1])
    # below: the 95 % interval of the prior, where it lies inside the axis
    wider = replace(parameters(), priors=(Prior(1.25e10, 1e8, "lognormal"), None, None))
    below = laid_out(lambda: pair_figure(replace(correlated(), parameters=replace(
        wider, values=correlated().parameters.values, covariance=correlated().parameters.covariance
    ))))  # fmt: skip
    (panel,) = [one for one in below.axes if one.get_ylabel() == "K0" and one.get_visible()]
    limits = sorted(float(line.get_xdata()[0]) for line in panel.get_lines()
                    if line.get_linestyle() == "--")  # fmt: skip
    assert limits == pytest.approx(
        12.5 * np.exp(1.96 * np.array([-1, 1]) * 1e8 / 1.25e10), rel=1e-4
    )


def drawn_posterior():
    """2,000 draws of E_rock (GPa, normal) and K0 with a correlation of 0.6."""
    result = example_result(2)
    z = np.random.default_rng(4).standard_normal((2000, 2))
    E, K0 = 10e9 + 1e9 * z[:, 0], 1.5 + 0.1 * (0.6 * z[:, 0] + 0.8 * z[:, 1])
    draws = np.stack([E, K0], axis=-1)
    found = SimpleNamespace(names=("E_rock", "K0"), flat=draws, least_effective=2000.0)
    prior = Prior(12e9, 2e9)
    priors = tuple(prior if n == "E_rock" else None for n in result.parameters.names)
    table = replace(result.parameters, priors=priors)
    case = "parameters: {E_rock: {start: 10 GPa}, K0: {start: 1}}"
    return replace(result, parameters=table, case_resolved=case), found


def test_draws_have_their_quantiles_their_prior_and_contours_that_hold_their_parts():
    result, found = drawn_posterior()
    figure = laid_out(lambda: corner_figure(result, found))
    rock, panel = figure.axes[:2]
    E, K0 = found.flat[:, 0] / 1e9, found.flat[:, 1]
    upright = sorted(
        float(line.get_xdata()[0]) for line in rock.get_lines() if len(line.get_xdata()) == 2
    )
    np.testing.assert_allclose(upright, np.quantile(E, [0.025, 0.5, 0.975]), rtol=1e-9)
    (prior,) = [line for line in rock.get_lines() if len(line.get_xdata()) > 2]
    np.testing.assert_allclose(prior.get_ydata(), norm.pdf(prior.get_xdata(), 12.0, 2.0))
    (bars,) = rock.patches
    counts, edges, _ = bars.get_data()
    assert np.sum(counts * np.diff(edges)) == pytest.approx(1.0)  # on one scale with the prior
    ellipse95 = next(line for line in panel.get_lines() if line.get_linestyle() == ":")
    assert 0.93 < np.mean(Path(ellipse95.get_xydata()).contains_points(np.stack([E, K0], 1))) < 0.97
    (contours,) = panel.collections
    for path, share in zip(contours.get_paths(), (0.95, 0.5), strict=True):
        inside = np.zeros(len(E), dtype=bool)
        for ring in path.to_polygons():
            inside |= Path(ring).contains_points(np.stack([E, K0], axis=1))
        assert np.mean(inside) == pytest.approx(share, abs=0.03)


def test_contours_of_draws_hold_their_parts_close_and_follow_a_narrow_valley():
    rng = np.random.default_rng(2)
    draws = rng.multivariate_normal([12.0, 8.0], [[1.0, 0.97], [0.97, 1.0]], 600).T
    (x, y), density, levels = draws_density(draws)
    at = RegularGridInterpolator((y, x), density)(draws[::-1].T)
    for level, share in zip(levels, (0.95, 0.5), strict=True):
        assert np.mean(at > level) == pytest.approx(share, abs=0.02)
        rim = np.concatenate([density[0], density[-1], density[:, 0], density[:, -1]])
        assert rim.max() < level  # the contour closes
    inside = np.array(np.meshgrid(x, y))[:, density > levels[0]]
    # as wide across the valley as the ellipse, which is 0.3 there and 3.4 along it
    assert np.abs(inside[1] - inside[0] + 4.0).max() < 2.448 * np.sqrt(2 * 0.03) * 1.35
    assert draws_density(np.stack([draws[0], draws[0]]))[2] == []
