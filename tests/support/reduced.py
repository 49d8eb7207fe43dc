"""Small staged cases that have a reduced model."""

from __future__ import annotations

import numpy as np

from geoident.forward.model import StagedModel
from geoident.model.actions import Pressure
from geoident.model.arrays import Floats
from geoident.model.case import Analysis, Material, Stage, Support
from geoident.model.ground import Attitude, Isotropic, TransverselyIsotropic
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Beam, Bolts, Struts

from .cases import displacement, material, model, rollers
from .force_gauges import gauge
from .meshes import box, regroup

MODULI = (Parameter("E", 8e9, 2e9, 3e10, "log"), Parameter("E_lining", 1e10, 3e9, 4e10, "log"))
POISSON = Parameter("nu", 0.25, 0.1, 0.4)
STRESS = (Parameter("sv", 5e6, 2e6, 1e7), Parameter("K0", 1.0, 0.4, 2.0))
HEIM = HeimStress(vertical=Scalar(1.0, "sv"), K0=Scalar(1.0, "K0"))


def _between(axis: int, low: float, high: float):
    return lambda c: (c[:, axis] > low) & (c[:, axis] < high)


def _all(*tests):
    return lambda c: np.all([test(c) for test in tests], axis=0)


def plane(kind: str = "quad4", n: int = 12, **changes) -> StagedModel:
    """A heading and a bench, lined after them; the lining hardens; a load case on the side.

    Five parameters: two moduli, a Poisson's ratio, the stress and K0.
    """
    mesh = regroup(
        box(kind, (n, n), size=(12.0, 12.0), distortion=0.05),
        heading=_all(_between(0, 0, 3), _between(1, 6, 8)),
        bench=_all(_between(0, 0, 3), _between(1, 4, 6)),
        lining=_all(_between(0, 3, 4), _between(1, 6, 8)),
    )
    stages = (
        Stage("heading", excavate=("heading", "lining")),
        Stage("lined", install={"lining": "young"}),
        Stage("test", loads={"plate": Pressure("y1", Scalar(2e5))}, independent=True),
        Stage("bench", excavate=("bench",), change={"lining": "shotcrete"}),
    )
    settings = {
        "parameters": (*MODULI, POISSON, *STRESS),
        "materials": {
            "rock": material("rock", Scalar(1.0, "E"), Scalar(1.0, "nu"), 2500.0),
            "young": material("young", Scalar(0.3, "E_lining"), 0.2, 2500.0),
            "shotcrete": material("shotcrete", Scalar(1.0, "E_lining"), 0.2, 2500.0),
        },
        "groups": dict.fromkeys(("rock", "heading", "bench", "lining"), "rock"),
        "supports": rollers(2),
        "in_situ": HEIM,
        "stages": stages,
        "channels": (
            displacement("roof", (1.0, 9.0), (0.0, 1.0), zero="heading"),
            displacement("wall", (4.0, 7.0), (1.0, 0.0), zero="heading"),
            displacement("side", (8.0, 5.0), (1.0, 0.0)),
            displacement("top", (2.0, 12.0), (0.0, 1.0)),
        ),
    }
    return model(mesh, **{**settings, **changes})


def solid(kind: str = "tet4", n: int = 4, **changes) -> StagedModel:
    """Two rounds of a drift, lined one behind; moduli and stress are sought."""
    mesh = regroup(
        box(kind, (n, n, n), size=(8.0, 8.0, 8.0), distortion=0.05),
        first=_all(_between(0, 0, 2), _between(1, 0, 4), _between(2, 4, 6)),
        second=_all(_between(0, 0, 2), _between(1, 4, 8), _between(2, 4, 6)),
        lining=_all(_between(0, 2, 4), _between(1, 0, 4), _between(2, 4, 6)),
    )
    settings = {
        "parameters": (*MODULI, *STRESS),
        "materials": {
            "rock": material("rock", Scalar(1.0, "E"), 0.25),
            "shotcrete": material("shotcrete", Scalar(1.0, "E_lining"), 0.2),
        },
        "groups": dict.fromkeys(("rock", "first", "second", "lining"), "rock"),
        "supports": rollers(3),
        "in_situ": HEIM,
        "stages": (
            Stage("first", excavate=("first", "lining")),
            Stage("lined", excavate=("second",), install={"lining": "shotcrete"}),
        ),
        "channels": (
            displacement("roof", (1.0, 4.0, 7.0), (0.0, 0.0, 1.0)),
            displacement("wall", (4.5, 2.0, 5.0), (1.0, 0.0, 0.0), zero="first"),
            displacement("far", (7.0, 7.0, 3.0), (1.0, 0.0, 0.0)),
        ),
    }
    return model(mesh, **{**settings, **changes})


def strata() -> StagedModel:
    """The plane case in strata whose moduli and dip are sought."""
    elastic = TransverselyIsotropic(
        Scalar(1.0, "E"), Scalar(0.2), Scalar(0.4, "E"), Scalar(0.1), Scalar(0.2, "E_lining"),
        Attitude(Scalar(1.0, "dip"), Scalar(np.pi / 2), Scalar(0.0)),
    )  # fmt: skip
    return plane(
        parameters=(*MODULI, Parameter("dip", 0.6, -1.2, 1.2), *STRESS),
        materials={
            "rock": Material("rock", elastic, Scalar(0.0)),
            "young": Material("young", Isotropic(E=Scalar(3e9), nu=Scalar(0.2))),
            "shotcrete": Material("shotcrete", Isotropic(E=Scalar(1e10), nu=Scalar(0.2))),
        },
    )


def released() -> StagedModel:
    """The plane case whose heading leaves with part of its stress held, until it is lined.

    The part is sought; the bench leaves as a whole.
    """
    part = {"heading": Scalar(1.0, "part"), "lining": Scalar(1.0, "part")}
    later = {"heading": Scalar(1.5, "part"), "lining": Scalar(1.5, "part")}
    stages = (
        Stage("heading", excavate=("heading", "lining"), release=part),
        Stage("lined", install={"lining": "young"}, release=later),
        Stage("test", loads={"plate": Pressure("y1", Scalar(2e5))}, independent=True),
        Stage("bench", excavate=("bench",), change={"lining": "shotcrete"}),
    )
    share = Parameter("part", 0.4, 0.1, 0.6)
    return plane(parameters=(*MODULI, POISSON, share, *STRESS), stages=stages)


def settling() -> StagedModel:
    """The plane case under gravity, whose in-situ stress is out of balance until it settles."""
    return plane(gravity=(0.0, -9.81))


def braced(**changes) -> StagedModel:
    """The plane case with a plate, bolts that go with a modulus, and struts jacked by a stress.

    The struts are jacked after the heading and locked off; the bolts go before the bench.
    """
    one, E = Scalar(1.0), Scalar(0.02, "E_lining")
    stages = (
        Stage("heading", excavate=("heading", "lining"), build=("plate", "bolts")),
        Stage("lined", install={"lining": "young"}, build=("struts",)),
        Stage("test", loads={"top": Pressure("y1", Scalar(2e5))}, independent=True),
        Stage("bench", excavate=("bench",), change={"lining": "shotcrete"}, dismantle=("bolts",)),
    )
    structures = {
        "plate": Beam("y1", E=Scalar(1.0, "E_lining"), thickness=Scalar(0.5)),
        "bolts": Bolts((((4.5, 7.0), (9.0, 7.5)), ((1.0, 8.5), (1.5, 11.0))), one, EA=E),
        "struts": Struts(
            (((4.5, 5.0), (8.0, 3.0)),), one, EA=Scalar(5e8), prestress=Scalar(0.05, "sv")
        ),
    }
    return plane(**{"stages": stages, "structures": structures, **changes})


def gauged() -> StagedModel:
    """The braced case with load cells on its bars and plate, and stress cells in the ground.

    Struts are read when they are jacked, and later; a bolt against its zero; the plate its moment.
    """
    force, stress = {"dimension": "force"}, {"dimension": "pressure"}
    moment = {"dimension": "moment per length", "quantity": "M", "towards": (6.0, 0.0)}
    channels = (
        displacement("roof", (1.0, 9.0), (0.0, 1.0), zero="heading"),
        displacement("side", (8.0, 5.0), (1.0, 0.0)),
        gauge("load-cell", "strut", (4.5, 5.0), "N", structure="struts", **force),
        gauge("load-cell", "bolt", (4.5, 7.0), "N", structure="bolts", zero="heading", **force),
        gauge("load-cell", "bent", (5.3, 12.0), structure="plate", **moment),
        gauge("stress", "xx", (6.0, 6.1), "xx", **stress),
        gauge("stress", "yy", (6.0, 6.1), "yy", zero="heading", **stress),
    )
    return braced(channels=channels)


def sinking(**changes) -> StagedModel:
    """A shaft sunk in four steps through two layers, about its axis; a ring follows behind.

    The ring is ground that leaves with its step and comes back as concrete. Most gauges are zeroed
    when their step is open, so that they see the steps after it alone.
    """
    steps = {1: (12, 16), 2: (8, 12), 3: (6, 8), 4: (4, 6)}
    parts = {f"core-{k}": _all(_between(0, 0, 2), _between(1, *y)) for k, y in steps.items()}
    parts |= {f"ring-{k}": _all(_between(0, 2, 3), _between(1, *y)) for k, y in steps.items()}
    mesh = regroup(
        box("quad4", (16, 16), size=(16.0, 16.0), distortion=0.05), **parts, lower=_between(1, 0, 8)
    )
    groups = {"rock": "marl", "lower": "claystone"}
    groups |= {name: "marl" if name[-1] in "12" else "claystone" for name in parts}
    stages = [Stage("step 1", excavate=("core-1", "ring-1"))]
    stages += [
        Stage(f"step {k}", excavate=(f"core-{k}", f"ring-{k}"), install={f"ring-{k - 1}": "ring"})
        for k in (2, 3, 4)
    ]
    settings = {
        "analysis": Analysis.AXISYMMETRIC,
        "parameters": (
            Parameter("E_upper", 1e9, 1e8, 2e10, "log"),
            Parameter("E_lower", 2e9, 1e8, 4e10, "log"),
            Parameter("K0", 0.7, 0.2, 3.0),
        ),
        "materials": {
            "marl": material("marl", Scalar(1.0, "E_upper"), 0.3, 2350.0),
            "claystone": material("claystone", Scalar(1.0, "E_lower"), 0.25, 2350.0),
            "ring": material("ring", 2e10, 0.2, 2350.0),
        },
        "groups": groups,
        "supports": (Support("x1", (0,)), Support("y0", (1,))),
        "gravity": (0.0, -9.81),
        "in_situ": HeimStress(
            unit_weight=Scalar(2350.0 * 9.81), surface=Scalar(16.0), K0=Scalar(1.0, "K0")
        ),
        "stages": tuple(stages),
        "channels": (
            displacement("top", (5.0, 16.0), (0.0, 1.0)),
            displacement("side", (5.0, 7.0), (1.0, 0.0)),
            displacement("wall-1", (3.0, 14.0), (1.0, 0.0), zero="step 1"),
            displacement("wall-2", (3.0, 10.0), (1.0, 0.0), zero="step 2"),
            displacement("wall-3", (3.0, 7.0), (1.0, 0.0), zero="step 3"),
        ),
    }
    return model(mesh, **{**settings, **changes})


PAIRS_PLANE = [
    ("roof", "lined"), ("roof", "bench"), ("wall", "lined"), ("wall", "bench"), ("side", "heading"),
    ("side", "bench"), ("top", "heading"), ("top", "test"), ("top", "bench"),
]  # fmt: skip
PAIRS_SOLID = [
    ("roof", "first"), ("roof", "lined"), ("wall", "lined"), ("far", "first"), ("far", "lined"),
]  # fmt: skip
PAIRS_SINKING = [
    *((name, f"step {k}") for name in ("top", "side") for k in (1, 2, 3, 4)), ("wall-1", "step 2"),
    ("wall-1", "step 4"), ("wall-2", "step 3"), ("wall-2", "step 4"), ("wall-3", "step 4"),
]  # fmt: skip


PAIRS_GAUGED = [
    ("roof", "bench"), ("side", "bench"), ("strut", "lined"), ("strut", "bench"), ("bolt", "lined"),
    ("bent", "heading"), ("bent", "bench"), ("xx", "heading"), ("xx", "bench"), ("yy", "bench"),
    ("yy", "test"),
]  # fmt: skip


def spread(staged: StagedModel, count: int, seed: int = 0, part: float = 1.0) -> Floats:
    """Random parameter vectors (count, n) inside a part of the bounds, evenly in their scales."""
    random = np.random.default_rng(seed)
    found = []
    for q in staged.case.parameters:
        x = 0.5 + part * (random.random(count) - 0.5)
        if q.scale == "log":
            found.append(q.lower * (q.upper / q.lower) ** x)
        else:
            found.append(q.lower + (q.upper - q.lower) * x)
    return np.array(found).T
