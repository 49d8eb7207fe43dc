"""What the make_mesh.py of the shipped cases have in common: options, gmsh and element sizes."""

import argparse
import itertools
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

import gmsh

# settings of gmsh; in the plane, a field alone says how large the elements are
_SIZES = {"Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MeshSizeFromPoints": 0}
SERENDIPITY = {"Mesh.SecondOrderIncomplete": 1}  # quad8 and hex20, not quad9 and hex27
TRIANGLES = {**_SIZES, "Mesh.Algorithm": 6}
QUADRILATERALS = {**_SIZES, "Mesh.Algorithm": 8, "Mesh.RecombineAll": 1, **SERENDIPITY}


def read_options(
    text: str | None,
    output: Path,
    *,
    order: int = 1,
    flags: Mapping[str, str] = MappingProxyType({}),
    **factors: str,
) -> argparse.Namespace:
    """The options of a script: size, order and output.

    Args:
        text: what the script says about itself.
        output: the mesh that is shipped.
        order: of its elements.
        flags: what the script can be told to do otherwise: name to meaning.
        factors: further factors that the script knows, and what they are.
    """
    parser = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawTextHelpFormatter
    )
    for name, meaning in {"size": "factor on all element sizes", **factors}.items():
        parser.add_argument(f"--{name}", type=float, default=1.0, help=meaning)
    for name, meaning in flags.items():
        parser.add_argument(f"--{name}", action="store_true", help=meaning)
    parser.add_argument("--order", type=int, default=order, choices=(1, 2), help="of the elements")
    parser.add_argument("--output", type=Path, default=output)
    return parser.parse_args()


@contextmanager
def mesh_file(
    options: argparse.Namespace, settings: Mapping[str, float], *, dim: int = 2
) -> Iterator[None]:
    """Meshes and writes the geometry that is built inside the block.

    Args:
        options: see `read_options`.
        settings: of gmsh.
        dim: of the elements.
    """
    gmsh.initialize(["-nopopup", "-v", "2"])
    for name, value in {**settings, "Mesh.Binary": 1}.items():
        gmsh.option.setNumber(name, value)
    yield
    gmsh.model.mesh.generate(dim)
    gmsh.model.mesh.setOrder(options.order)
    gmsh.write(str(options.output))
    gmsh.finalize()


def lines(points: list[int]) -> list[int]:
    """Lines from point to point."""
    return [gmsh.model.geo.addLine(a, b) for a, b in itertools.pairwise(points)]


def grow(size: float, near: Iterable[tuple[float, float, str, list[int]]]) -> None:
    """Element sizes: as told at some curves and points, growing with the distance.

    Args:
        size: factor on all of them.
        near: size, growth per metre, ``CurvesList`` or ``PointsList``, and their tags.
    """
    field = gmsh.model.mesh.field
    sizes = []
    for fine, growth, kind, tags in near:
        distance = field.add("Distance")
        field.setNumbers(distance, kind, tags)
        field.setNumber(distance, "Sampling", 200)
        sizes.append(field.add("MathEval"))
        field.setString(sizes[-1], "F", f"{size} * ({fine} + {growth} * F{distance})")
    smallest = field.add("Min")
    field.setNumbers(smallest, "FieldsList", sizes)
    field.setAsBackgroundMesh(smallest)
