"""Which cases the reduced model covers, and which not and why (theory 14).

Covered: elastic ground of every symmetry, with ratios and angles of its axes among the parameters;
excavation, installation, changes of material; walls, linings, bolts, struts and anchors, stressed
once at most; independent load cases; in-situ stress, weights, loads and water whose forces are
polynomials of low degree in the parameters; partial release of ground whose stress is the one in
situ, so that what is held is such a force too; readings that are motions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from geoident.forward.march.march import March


def reduction_obstacle(march: March) -> str | None:
    """Why the march of a case has no reduced model, a clause, or None if it may have one.

    Whether its loads have the form that is needed is found by trying, see `loads.load_form`.
    """
    return next(_obstacles(march), None)


def _obstacles(march: March) -> Iterator[str]:
    case = march.case
    if not case.parameters:
        yield "nothing is sought"
    for name in march.sequence.materials:
        if case.materials[name].yields:
            yield f"{name} yields: its stresses are not linear in the displacements"
    for field in march.on_mesh.fields:
        yield f"{field.constant} of {field.material} is a field"
    for growth in case.growths:
        yield growth.words
    jacked = [name for state in march.sequence.states for name in state.stressed]
    for name, count in Counter(jacked).items():
        if count > 1:
            yield f"the bars of '{name}' are stressed more than once"
    yield from _of_stages(march)


def _of_stages(march: March) -> Iterator[str]:
    moved = march.motions.moved()
    if moved is not None:
        yield f"the support '{moved}' is moved"
    for stage in march.case.stages:
        if stage.supports:
            yield f"the stage '{stage.name}' changes what is held"
    for stage in march.case.stages:
        if stage.temperature:
            yield f"the stage '{stage.name}' changes temperatures"
    for state in march.sequence.states:
        if state.base and state.release.keys() & state.leaving:
            yield (
                f"the stage '{state.name}' releases in part the stress of ground that other stages "
                "have changed before"
            )


def releases(march: March) -> bool:
    """Whether any stage holds part of the stress of what left."""
    return any(state.release for state in march.sequence.states)
