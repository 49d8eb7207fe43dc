"""Exact derivatives against Richardson's extrapolation of central differences.

A run costs, and four of them for each parameter most of all. So all parameters are moved at once,
each as far as its column of the Jacobian moves the readings as much as the others do: a column that
is wrong shows there as it does alone. Only where the differences do not agree along that way (by
a mistake, or as the readings bend too much along it) each parameter is moved by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from geoident.forward.response import StagedResponse

Readings = Callable[[np.ndarray], np.ndarray]


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
        assert np.abs(jacobian[:, h]).max() > 0, f"{name} acts on nothing in this test"
    assert_slopes(response.readings, p, jacobian, names, step=step, rtol=rtol)


def assert_slopes(
    function: Readings,
    p: np.ndarray,
    jacobian: np.ndarray,
    names: Sequence[str],
    *,
    step: float,
    rtol: float = 1e-7,
) -> None:
    """The Jacobian (g, n) of a function at p (n,) agrees with differences.

    Args:
        function: values (g,) of a point (n,).
        p: where.
        jacobian: what is judged; a column of zeros says that its parameter moves nothing.
        names: of the parameters, for what is said of a column that is wrong.
        step: largest step, as a part of each parameter.
        rtol: largest error of a column, as a part of its largest entry.
    """
    scale = np.abs(jacobian).max(axis=0)
    acts = np.flatnonzero(scale > 0)
    way = together(p, scale, acts, step)
    expected = jacobian @ way
    smallest = (scale * np.abs(way))[acts].min(initial=np.inf)
    if acts.size and np.allclose(
        differences(function, p, way), expected, rtol=0.0, atol=2 * rtol * smallest
    ):
        left = np.flatnonzero(scale == 0)
    else:
        left = np.arange(len(p))
    for h in left:
        numeric = richardson(function, p, h, step * abs(p[h]))
        np.testing.assert_allclose(
            jacobian[:, h], numeric, atol=rtol * scale[h], err_msg=str(names[h])
        )


def together(p: np.ndarray, scale: np.ndarray, acts: np.ndarray, step: float) -> np.ndarray:
    """A step (n,) by which all that act move what is read about as much.

    Half as much for some, lest what is wrong with all of them in the same way cancels out.
    """
    way = np.zeros(len(p))
    weight = 0.5 + 0.5 * np.modf(0.618 * np.arange(len(p)))[0]
    sign = 1.0 - 2.0 * (np.arange(len(p)) % 2)
    moves = scale[acts] * np.abs(p[acts])
    way[acts] = step * np.abs(p[acts]) * (sign * weight)[acts] * moves.min(initial=np.inf) / moves
    return way


def assert_adjoint(response: StagedResponse, p: np.ndarray, *, rtol: float = 1e-10) -> None:
    """Adjoints are tangents: the same readings, the same Jacobian."""
    (v, tangents), (w, adjoints) = response.by_tangents(p), response.by_adjoints(p)
    np.testing.assert_allclose(w, v, rtol=1e-12)
    size = np.abs(tangents).max(axis=0)
    np.testing.assert_allclose(adjoints / size, tangents / size, rtol=0.0, atol=rtol)


def richardson(function: Readings, p: np.ndarray, h: int, step: float) -> np.ndarray:
    """Derivative of a function of p by p[h], to the fourth order of a quarter of the step."""
    return differences(function, p, step * np.eye(len(p))[h]) / step


def differences(function: Readings, p: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Change of a function of p along a way (n,) by its slope at p, to the fourth order."""

    def change(k: int) -> np.ndarray:
        return (function(p + way / k) - function(p - way / k)) * k / 2

    return (4 * change(4) - change(2)) / 3
