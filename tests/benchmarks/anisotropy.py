"""What general anisotropy costs: K and all its components for 21 moduli against 2.

Run: python tests/benchmarks/anisotropy.py [elements]

Ratios within one run; seconds depend on the machine. `K(p)`: the values of the stiffness matrix for
new moduli. `components`: K_h for every modulus h, as theory 1 has it: K = sum c_h K_h. `analysis`:
one stage with its Jacobian by all moduli, per parameter.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.anisotropy import general, random_definite, ties
from support.cases import model, rollers
from support.meshes import box

from geoident.forward.ground.elasticity import elastic_matrix
from geoident.model.actions import Pressure
from geoident.model.case import Material, Stage
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Anisotropic, Isotropic, constants
from geoident.model.parameter import Parameter, Scalar


def best(work: Callable[[], object], repeats: int = 5) -> float:
    """Seconds of the quickest of some runs."""
    times = []
    for _ in range(repeats):
        begin = perf_counter()
        work()
        times.append(perf_counter() - begin)
    return min(times)


def staged(cells: int, elastic: Isotropic | Anisotropic, starts: dict[str, float]):
    parameters = tuple(Parameter(n, v, -np.inf, np.inf) for n, v in starts.items())
    return model(
        box("tet4", (cells,) * 3, distortion=0.1),
        parameters=parameters,
        materials={"rock": Material("rock", elastic)},
        groups={"all": "rock"},
        supports=rollers(3),
        stages=(Stage("load", loads={"q": Pressure("z1", Scalar(1e6))}),),
    )


def measure(cells: int, elastic: Isotropic | Anisotropic, starts: dict[str, float]):
    """Seconds of K(p), of all components, and of the assembly from nothing."""
    case = staged(cells, elastic, starts)
    state, system = case.sequence.states[1], case.systems[1]
    rock = case.case.materials["rock"].elastic

    def moduli() -> Dual:
        return elastic_matrix(rock, ParameterPoint(starts, tuple(starts)), section=False)

    def assemble() -> None:
        case.systems.stiffness_values(system, state, {"rock": moduli().value.copy()}, starts)

    def components() -> None:
        for slope in map(moduli().slope, range(len(starts))):
            if slope is not None:
                case.systems.stiffness_values(system, state, {"rock": slope}, starts)

    def first() -> None:
        staged(cells, elastic, starts).systems[1]

    return case.mesh.n_elements, best(assemble), best(components), best(first, 2)


def main() -> None:
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
    cells = round((wanted / 6) ** (1 / 3))
    entries = general(random_definite(np.random.default_rng(1)))
    numbers = {name: scalar.factor for name, scalar in constants(entries).items()}
    two = {"K": 8e9, "G": 5e9}
    n, *iso = measure(cells, Isotropic(**ties(two)), two)
    _, *general_ = measure(cells, Anisotropic(ties(numbers)), numbers)
    print(f"{n} tet4 elements; seconds for 2 moduli, for 21, ratio")
    for name, a, b in zip(("K(p)", "components K_h", "from the mesh"), iso, general_, strict=True):
        print(f"{name:15} {a:8.4f} {b:8.4f} {b / a:6.2f}")
    total = [sum(x) for x in (iso[1:], general_[1:])]
    print(f"{'mesh and all K_h':15} {total[0]:7.4f} {total[1]:8.4f} {total[1] / total[0]:6.2f}")


if __name__ == "__main__":
    main()
