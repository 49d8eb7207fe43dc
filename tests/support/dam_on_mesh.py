"""A gravity dam on its rock, meshed by hand, in service under a reservoir and the weather.

Readings are made by the program itself at given parameters, on this mesh or on a finer one, with
noise: tests ask whether the parameters come back. What the model computes is judged by closed forms
elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geoident.fem.solvers import pick_solver
from geoident.forward.in_service.structure import ServiceModel, service_model
from geoident.io.case.file import read_case
from geoident.io.mesh.file import read_mesh
from geoident.model.mesh import Mesh
from support.meshes import build, with_outer_faces
from support.service_dam import YEAR, dam, lasting

HEIGHT, BASE, CREST = 60.0, 46.0, 6.0
FIRST = np.datetime64("2010-01-01")
TRUTH = {"E_dam": 24e9, "E_rock": 36e9, "alpha": 1.05e-5, "k": 2.6}


def _halved(places: np.ndarray) -> np.ndarray:
    """With a place more in the middle of any two."""
    return np.sort(np.concatenate([places, 0.5 * (places[1:] + places[:-1])]))


def section(*, fine: bool = False, kind: str = "quad8") -> Mesh:
    """Dam and rock; x downstream from the heel, y upwards from the base; thin behind the faces.

    Args:
        fine: with elements of half the size.
        kind: of the elements.
    """
    t = np.array([0.0, 0.05, 0.15, 0.38, 0.66, 0.87, 0.95, 1.0])
    heights = HEIGHT * np.append(np.linspace(0.0, 0.875, 8), [0.96, 1.0])
    ends = np.array([-110.0, -60.0, -25.0, -8.0]), np.array([BASE + 10.0, 80.0, 110.0, 160.0])
    depths = np.array([-100.0, -55.0, -25.0, -10.0, -4.0, -1.5, 0.0])
    if fine:
        t, heights, depths = (_halved(places) for places in (t, heights, depths))
    nx = len(t) - 1
    width = BASE + (CREST - BASE) * heights / HEIGHT
    x = np.concatenate([ends[0], BASE * t, ends[1]])
    if fine:
        sides = _halved(x[:5]), BASE * t[1:-1], _halved(np.append(BASE, ends[1]))
        x = np.unique(np.concatenate(sides))
    first = int(np.flatnonzero(np.abs(x) < 1e-9)[0])
    points = [*((a, y) for y in depths for a in x)]
    cells, n = [], len(x)
    for j in range(len(depths) - 1):
        for i in range(n - 1):
            a = j * n + i
            cells.append((a, a + 1, a + n + 1, a + n))
    n_rock = len(cells)
    below = [(len(depths) - 1) * n + first + i for i in range(nx + 1)]
    for y, w in zip(heights[1:], width[1:], strict=True):
        row = [len(points) + i for i in range(nx + 1)]
        points += [(w * s, y) for s in t]
        cells += [(below[i], below[i + 1], row[i + 1], row[i]) for i in range(nx)]
        below = row
    mesh = build(kind, np.array(points), np.array(cells))
    number = np.arange(len(cells))
    groups = {"rock": number[:n_rock], "dam": number[n_rock:]}
    outer = with_outer_faces(mesh)
    middle = [outer.points[block.nodes].mean(axis=1) for block in outer.facets]
    px, py = np.concatenate(middle).T
    on_slope = np.abs(px - (BASE + (CREST - BASE) * py / HEIGHT)) < 1e-6
    faces = {
        "upstream": (np.abs(px) < 1e-6) & (py > 0.0),
        "floor": (np.abs(py) < 1e-6) & (px < 0.0),
        "downstream": on_slope & (py > 0.0) & (py < HEIGHT - 1e-6),
        "crest": np.abs(py - HEIGHT) < 1e-6,
        "ground": (np.abs(py) < 1e-6) & (px > BASE),
        "bottom": np.abs(py + 100.0) < 1e-6,
        "sides": (np.abs(px + 110.0) < 1e-6) | (np.abs(px - 160.0) < 1e-6),
    }
    named = {name: np.flatnonzero(on) for name, on in faces.items()}
    return Mesh(outer.points, outer.blocks, outer.facets, groups, named)


_GMSH = {"quad8": 16, "line3": 8, "quad4": 3, "line2": 1}


def write_mesh(path: Path, mesh: Mesh) -> None:
    """A mesh with its groups of elements and faces, as MSH 2.2."""
    faces = [(block.kind, nodes) for block in mesh.facets for nodes in block.nodes]
    cells = [(block.kind, nodes) for block in mesh.blocks for nodes in block.nodes]
    groups = [(1, faces, mesh.facet_groups), (2, cells, mesh.groups)]
    names, rows = [], []
    for dim, parts, members in groups:
        for name, numbers in members.items():
            names.append(f'{dim} {len(names) + 1} "{name}"')
            rows += [(*parts[k], len(names)) for k in numbers]
    text = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names)), *names]
    text += ["$EndPhysicalNames", "$Nodes", str(mesh.n_nodes)]
    text += [f"{n} {x:.12g} {y:.12g} 0" for n, (x, y) in enumerate(mesh.points, start=1)]
    text += ["$EndNodes", "$Elements", str(len(rows))]
    for n, (kind, nodes, group) in enumerate(rows, start=1):
        text.append(f"{n} {_GMSH[kind]} 2 {group} {group} {' '.join(str(k + 1) for k in nodes)}")
    path.write_text("\n".join([*text, "$EndElements", ""]))


CASE = """format: geoident-case/1
title: A gravity dam in service
analysis: plane-strain
mesh: {file: dam.msh}
parameters:
  E_dam:  {start: 18 GPa, bounds: [5 GPa, 60 GPa], scale: log}
  E_rock: {start: 25 GPa, bounds: [2 GPa, 100 GPa], scale: log}
  alpha:  {start: 0.8e-5 1/K, bounds: [0.4e-5 1/K, 2e-5 1/K]}
  k:      {start: 2 W/mK, bounds: [0.5 W/mK, 8 W/mK], scale: log}
materials:
  concrete: {E: $E_dam, nu: 0.2, density: 2400 kg/m3, expansion: $alpha, conductivity: $k,
             specific_heat: 900 J/kgK}
  rock: {E: $E_rock, nu: 0.25, density: 2700 kg/m3, expansion: 0.8e-5 1/K,
         conductivity: 3 W/(m K), heat_capacity: 2.2 MJ/(m3 K)}
groups: {rock: rock, dam: absent}
supports: {sides: x, bottom: [x, y]}
gravity: 9.81 m/s2
in_situ: {model: heim, unit_weight: 26.487 kN/m3, surface: 0 m, K0: 0.6}
stages:
  - {name: in service, install: {dam: concrete}}
loads:
  level: {file: loads.csv}
  air: {file: loads.csv}
  water_temperature: {model: zhu, depth: 58 m, surface: 11 degC, bottom: 6 degC, amplitude: 8 K,
                      warmest: 07-20}
service:
  since: 2010-01-01
  faces: {wetted: [upstream, floor], air: [downstream, crest, ground]}
  film: 20 W/m2K
  linear: true
gauges:
  P58:
    {kind: displacement, component: x,
     point: [2 m, 58 m], relative_to: [2 m, 2 m], accuracy: 0.15 mm}
  P30:
    {kind: displacement, component: x,
     point: [2 m, 30 m], relative_to: [2 m, 2 m], accuracy: 0.15 mm}
  IP:
    {kind: displacement, component: x,
     point: [2 m, 2 m], relative_to: [2 m, -50 m], accuracy: 0.1 mm}
  L58:
    {kind: displacement, component: y,
     point: [3 m, 58 m], relative_to: [3 m, 2 m], accuracy: 0.3 mm}
  EH: {kind: extensometer, head: [3 m, 1 m], anchors: {a20: [3 m, -20 m]}, accuracy: 0.05 mm}
readings: readings.csv
fit: {until: 2016-01-01}
"""


def date(day: float) -> str:
    """ISO."""
    return str(FIRST + int(day))


def _motion(
    model: ServiceModel, values: Mapping[str, float], row: int, times: np.ndarray
) -> np.ndarray:
    """(k,) what a channel reads, mm: the water in full, temperatures less their mean."""
    p = np.array([values[name] for name in model.names])
    acting = model.motions(p, np.full(len(times), row), times)
    return 1e3 * (acting.total[:, 0] - acting.parts["temperature"][:, 0].mean())


@dataclass(frozen=True)
class Happening:
    """What happens to the dam.

    Args:
        changes: channel to what is added to its readings, a function of the day, mm.
        day: from which on parameters have other values.
        becomes: these, by name, SI.
    """

    changes: Mapping[str, Callable[[np.ndarray], np.ndarray]] = field(default_factory=dict)
    day: float = 0.0
    becomes: Mapping[str, float] = field(default_factory=dict)


def write(folder: Path, *, seed: int = 3, case: str = CASE, years: float = 9.0, every: float = 12.0,
          fine: bool = False, changes=None, noise: float = 1.0,
          truth: Mapping[str, float] = TRUTH, physics: str = "", noises: int = 0,
          also: Mapping[str, Happening] | None = None) -> Path:  # fmt: skip
    """The case with its mesh, loads and readings.

    Args:
        folder: where.
        seed: of weather and noise.
        case: its text.
        years: of service.
        every: days between readings.
        fine: readings are computed on a mesh of twice as many elements.
        noise: factor on it.
        changes: channel to what is added to its readings, a function of the day, mm.
        truth: the parameters.
        physics: text of the case that the readings are of; that of the case without other word.
        noises: other seeds for the noise alone.
        also: files with the same readings, to which something happens.
    """
    folder.mkdir(parents=True, exist_ok=True)
    weather = dam(seed, years=years, every=every)
    rng = np.random.default_rng(seed + 100 + 1000 * noises)
    level = 12.0 + (weather.level - 70.0) / 55.0 * 45.0
    rows = zip(weather.days, level, weather.air, strict=True)
    (folder / "loads.csv").write_text(
        "date,level (m),air (degC)\n" + "".join(f"{date(d)},{z:.3f},{t:.2f}\n" for d, z, t in rows)
    )
    write_mesh(folder / "dam.msh", section())
    path = folder / "dam.yaml"
    path.write_text((physics or case).replace("readings: readings.csv\n", ""))
    read = read_case(str(path)).case
    mesh = section(fine=True) if fine else read_mesh(str(folder / "dam.msh"), dim=2)
    model = service_model(mesh, read, solver=pick_solver("auto"))
    files = {"readings.csv": Happening(changes or {}), **(also or {})}
    lines = {name: ["gauge,date,value,unit"] for name in files}
    start = FIRST.astype("datetime64[s]").astype(float)
    read_on, errors = [], []
    for channel in read.channels:
        days = np.round(np.arange(rng.uniform(0, every), weather.days[-1] - 1, every))
        size = 1e3 * channel.accuracy * noise
        error = 0.15 * days / YEAR + rng.uniform(-3, 3)
        error += 0.8 * size * rng.standard_normal(len(days)) + lasting(days, 0.6 * size, 25.0, rng)
        read_on.append(days)
        errors.append(error)

    def motions(values):
        """Of all channels at one parameter vector, which costs one analysis."""
        return [
            _motion(model, values, row, start + days * 86400.0) for row, days in enumerate(read_on)
        ]

    as_built = motions(truth)
    for name, happening in files.items():
        later = motions({**truth, **happening.becomes}) if happening.becomes else as_built
        for row, channel in enumerate(read.channels):
            days = read_on[row]
            y = np.where(days > happening.day, later[row], as_built[row]) + errors[row]
            if channel.name in happening.changes:
                y = y + happening.changes[channel.name](days)
            lines[name] += [
                f"{channel.name},{date(d)},{v:.4f},mm" for d, v in zip(days, y, strict=True)
            ]
    for name, rows_of_file in lines.items():
        (folder / name).write_text("\n".join(rows_of_file) + "\n")
    path.write_text(case)
    return path
