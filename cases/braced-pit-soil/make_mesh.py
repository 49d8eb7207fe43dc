"""Makes the mesh of this case: that of ../braced-pit, coarser, with the wall in each layer.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.6 --triangles --slices --output fine.msh

Sizes are in parts of those of the shipped mesh. Needs gmsh.
"""

import runpy
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
COARSER = 1.8


def main() -> None:
    words = sys.argv[1:]
    size = float(words[words.index("--size") + 1]) if "--size" in words else 1.0
    output = [] if "--output" in words else ["--output", str(HERE / "pit.msh")]
    script = HERE.parent / "braced-pit" / "make_mesh.py"
    sys.argv = [str(script), *words, *output, "--layers", "--size", f"{COARSER * size:.6g}"]
    runpy.run_path(str(script), run_name="__main__")


if __name__ == "__main__":
    main()
