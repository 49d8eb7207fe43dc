"""One whole fit of a case beside one forward solve of its first stage by CalculiX.

    python tests/benchmarks/peer.py [cases/tunnel-3d/case.yaml]

Needs Debian's calculix-ccx. Both run on the same mesh and machine, one after the other; read the
ratio, not the seconds.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from support import calculix

from geoident.fem.solvers import pick_solver
from geoident.forward.model import staged_model
from geoident.io.case.file import read_case
from geoident.io.mesh.file import read_mesh


def main() -> None:
    case_file = sys.argv[1] if len(sys.argv) > 1 else "cases/tunnel-3d/case.yaml"
    threads = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as folder:
        peer = time_peer(case_file, Path(folder) / "stage.inp", threads)
        start = time.perf_counter()
        output = str(Path(folder) / "result.h5")
        command = [sys.executable, "-m", "geoident", "fit", "--fresh", case_file, "-o", output]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        fit = time.perf_counter() - start
    print(f"CalculiX, one forward solve of the first stage: {peer:.1f} s")
    print(f"geoident, the whole fit with prediction:        {fit:.1f} s")
    print(f"ratio fit / forward solve:                      {fit / peer:.2f}")


def time_peer(case_file: str, path: Path, threads: int) -> float:
    """Seconds of one CalculiX run."""
    loaded = read_case(case_file)
    mesh = read_mesh(loaded.mesh_path, dim=loaded.case.analysis.dim)
    staged = staged_model(mesh, loaded.case, solver=pick_solver())
    calculix.write_first_stage(staged, path)
    start = time.perf_counter()
    calculix.solve(path, threads=threads)
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
