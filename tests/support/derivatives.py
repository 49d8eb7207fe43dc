"""Exact derivatives against Richardson's extrapolation of central differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geoident.forward.response import StagedResponse


def assert_exact(
    response, p: np.ndarray, names: tuple[str, ...], *, step: float = 2e-3, rtol: float = 1e-7
) -> None:
    """The Jacobian of a response at p agrees with differences, and every parameter acts.

    Where the response has adjoints, they agree with the tangents to rounding.
    """
    v, jacobian = response.evaluate(p)
    if isinstance(response, StagedResponse) and response.adjoints.obstacle is None:
        assert_adjoint(response, p)
    np.testing.assert_allclose(response.readings(p), v, rtol=1e-12, atol=1e-14 * np.abs(v).max())
    for h, name in enumerate(names):
        numeric = richardson(response.readings, p, h, step * abs(p[h]))
        scale = np.abs(jacobian[:, h]).max()
        assert scale > 0, f"{name} acts on nothing in this test"
        np.testing.assert_allclose(jacobian[:, h], numeric, atol=rtol * scale, err_msg=name)


def assert_adjoint(response: StagedResponse, p: np.ndarray, *, rtol: float = 1e-10) -> None:
    """Adjoints are tangents: the same readings, the same Jacobian."""
    (v, tangents), (w, adjoints) = response.by_tangents(p), response.by_adjoints(p)
    np.testing.assert_allclose(w, v, rtol=1e-12)
    size = np.abs(tangents).max(axis=0)
    np.testing.assert_allclose(adjoints / size, tangents / size, rtol=0.0, atol=rtol)


def richardson(
    function: Callable[[np.ndarray], np.ndarray], p: np.ndarray, h: int, step: float
) -> np.ndarray:
    """Derivative of a function of p by p[h], to the fourth order of a quarter of the step."""
    unit = step * np.eye(len(p))[h]

    def slope(k: int) -> np.ndarray:
        return (function(p + unit / k) - function(p - unit / k)) / (2 * step / k)

    return (4 * slope(4) - slope(2)) / 3
