"""An adit in inclined strata and another one beside it: a case whose misfit has several minima."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from geoident.fem.solvers import pick_solver
from geoident.forward.model import staged_model
from geoident.io.case.file import read_case
from geoident.io.mesh.file import read_mesh
from geoident.model.mesh import Mesh

from .deck import write_deck
from .meshes import box, regroup

PARAMETERS = {
    "E_p": "{start: 15 GPa, bounds: [2 GPa, 80 GPa], scale: log}",
    "E_n": "{start: 8 GPa, bounds: [1 GPa, 80 GPa], scale: log}",
    "dip": "{start: 20 deg, bounds: [-89 deg, 89 deg]}",
    "K0": "{start: 1.0, bounds: [0.3, 3.0]}",
}
STRATA = (
    "{elastic: transversely-isotropic, E_p: $E_p, nu_p: 0.2, E_n: $E_n, nu_np: 0.1, "
    "G_np: 0.4 $E_n, dip: $dip}"
)
GAUGES = {
    "h": ((-4, 0), (4, 0)),
    "v": ((0, -4), (0, 4)),
    "d1": ((-4, 0), (0, 4)),
    "d2": ((0, 4), (4, 0)),
    "d3": ((-4, 0), (0, -4)),
    "e1": ((4, 4), (9, 9)),
    "e2": ((-4, 4), (-9, 9)),
    "e3": ((0, 4), (0, 12)),
    "e4": ((4, 0), (12, 0)),
}
TRUTH = {"E_p": 20e9, "E_n": 6e9, "dip": np.radians(-40.0), "K0": 1.3}


def write_case(
    folder: Path,
    *,
    parameters: Mapping[str, str] | None = None,
    rock: str = STRATA,
    gauges: Sequence[str] = tuple(GAUGES),
    accuracy: str = "0.2 mm",
    fit: str = "{stages: [dig], mesh_error: false}",
    name: str = "case.yaml",
) -> Path:
    """The case and its mesh in a folder, without readings."""
    write_deck(adit(), folder / "adit.inp")
    given = parameters or PARAMETERS
    channels = "".join(
        f"  {gauge}: {{kind: convergence, accuracy: {accuracy}, between: "
        f"[[{20 + a} m, {20 + b} m], [{20 + c} m, {20 + d} m]]}}\n"
        for gauge, ((a, b), (c, d)) in GAUGES.items()
        if gauge in gauges
    )
    (folder / name).write_text(
        "format: geoident-case/1\ntitle: Adit in strata\nanalysis: plane-strain\n"
        "mesh: {file: adit.inp}\nparameters:\n"
        + "".join(f"  {key}: {text}\n" for key, text in given.items())
        + f"materials:\n  rock: {rock}\n"
        "groups: {rock: rock, core: rock, second: rock}\n"
        "supports: {x0: x, y0: y}\n"
        "in_situ: {model: heim, vertical: 8 MPa, K0: $K0}\n"
        "stages:\n  - {name: dig, excavate: [core]}\n  - {name: second, excavate: [second]}\n"
        f"gauges:\n{channels}readings: readings.csv\nfit: {fit}\n"
    )
    return folder / name


def adit() -> Mesh:
    """A square opening in a square of rock, and another one that is dug later beside it."""
    return regroup(
        box("quad8", (10, 10), size=(40.0, 40.0)),
        core=lambda c: np.abs(c - 20.0).max(axis=1) < 4.0,
        second=lambda c: np.abs(c - np.array([8.0, 20.0])).max(axis=1) < 4.0,
    )


def write_readings(
    case: Path, truth: Mapping[str, float], seed: int, *, noise: float = 1.0, name: str = ""
) -> Path:
    """Readings of all stages of a case at a truth, with errors of their accuracy."""
    path = case.parent / (name or "readings.csv")
    path.write_text("gauge,stage,value,unit\n")
    loaded = read_case(str(case))
    model = staged_model(
        read_mesh(str(loaded.mesh_path), dim=2), loaded.case, solver=pick_solver("auto")
    )
    rng = np.random.default_rng(seed)
    pairs = [(c.name, s.name) for s in loaded.case.stages for c in loaded.case.channels]
    values = model.response(pairs).readings(
        np.array([truth[q.name] for q in loaded.case.parameters])
    )
    accuracy = {c.name: c.accuracy for c in loaded.case.channels}
    errors = [noise * accuracy[channel] * rng.standard_normal() for channel, _ in pairs]
    rows = [
        f"{channel},{stage},{1e3 * (value + error):.9f},mm"
        for (channel, stage), value, error in zip(pairs, values.tolist(), errors, strict=True)
    ]
    path.write_text("\n".join(["gauge,stage,value,unit", *rows]) + "\n")
    return path
