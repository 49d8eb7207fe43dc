"""What a command found: plain tables in SI units, ready to be written and shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.certificate import Certificate
from geoident.model.mesh import Mesh

NORMAL_95 = 1.959963984540054
"""Half width of a normal 95 % interval, in standard deviations."""


@dataclass(frozen=True)
class Counts:
    """What the computation cost.

    Args:
        evaluations: parameter vectors at which the model was evaluated.
        analyses: symbolic analyses of a sparsity pattern.
        factorizations: numeric factorizations.
        solves: right-hand sides solved.
    """

    evaluations: int = 0
    analyses: int = 0
    factorizations: int = 0
    solves: int = 0


@dataclass(frozen=True)
class ParameterTable:
    """The identified parameters, one entry of every array each.

    A parameter that is not determined keeps its ``value`` for further computing but has NaN in
    ``sd``, ``lower95``, ``upper95``; whoever shows it says "not determined" in place of the number.

    Args:
        names: n names.
        values: (n,) SI.
        sd: (n,) standard deviation, SI.
        lower95: (n,) lower end of the 95 % interval, SI.
        upper95: (n,) upper end.
        lower: (n,) lower bound.
        upper: (n,) upper bound.
        start: (n,) start value.
        at_bound: (n,) the value lies on a bound.
        determined: (n,) readings (and prior) determine it.
        priors: n texts such as ``normal(8e6, 1e6)``, empty for none.
        units: n units for display, as the user wrote them.
        dimensions: n keys of `geoident.units.DIMENSIONS`.
        covariance: (n, n) SI; NaN rows where not determined.
        correlation: (n, n).
    """

    names: tuple[str, ...]
    values: Floats
    sd: Floats
    lower95: Floats
    upper95: Floats
    lower: Floats
    upper: Floats
    start: Floats
    at_bound: Bools
    determined: Bools
    priors: tuple[str, ...]
    units: tuple[str, ...]
    dimensions: tuple[str, ...]
    covariance: Floats
    correlation: Floats


@dataclass(frozen=True)
class GaugeTable:
    """Readings and their counterparts, all (n_channels, n_stages), m; NaN where there is none.

    Args:
        channels: names of the channels.
        stages: names of the stages, the virgin state not among them.
        measured: readings.
        computed: the model at the estimate.
        sd: accuracy of each reading.
        used: the reading took part in the identification.
        first: (n_channels, dim) reference points, NaN for fixed ground.
        second: (n_channels, dim) points whose motion is read.
        bad: the reading is known to be wrong; the reason is among the notes.
    """

    channels: tuple[str, ...]
    stages: tuple[str, ...]
    measured: Floats
    computed: Floats
    sd: Floats
    used: Bools
    first: Floats
    second: Floats
    bad: Bools


@dataclass(frozen=True)
class Prediction:
    """What the channels will show, all (n_channels, n_stages), m; NaN where not predicted.

    ``sd`` holds the uncertainty of the parameters and the accuracy of the gauge (theory 6).
    """

    mean: Floats
    sd: Floats
    lower95: Floats
    upper95: Floats


@dataclass(frozen=True)
class Diagnostics:
    """How each used reading bears on the answer; NaN where none was used.

    Several readings of a gauge in one stage are removed together; of them the one farthest off
    has its residual and weight here.

    Args:
        loss: the loss that was minimised, such as ``huber (delta 1.345)``.
        squares: plain weighted squares (and the prior's part) at the estimate, whatever the loss.
        scale: robust scatter of the standardized residuals: near 1 if the accuracies are right.
        standardized: (n_channels, n_stages) measured minus computed, in accuracies.
        studentized: the same in its own standard deviation, by root of 1 - leverage.
        weight: what the loss leaves of the reading, 0 to 1.
        leverage: diagonal of the hat matrix: 1 decides alone.
        distance: Cook's distance.
        influence: (n_channels, n_stages, n) change of each parameter by the reading, in standard
            deviations of the parameter (DFBETAS); infinite where nothing else determines it.
    """

    loss: str
    squares: float
    scale: float
    standardized: Floats
    studentized: Floats
    weight: Floats
    leverage: Floats
    distance: Floats
    influence: Floats


@dataclass(frozen=True)
class Iteration:
    """One step of an identifier.

    Args:
        method: name of the method.
        number: from 0 (the start).
        objective: the discrepancy (with the prior's part) at ``values``.
        values: (n,) parameters, SI.
        step: size of the step in scaled parameters.
        counts: costs up to here.
        note: such as ``accepted``, ``rejected``, ``restart``.
    """

    method: str
    number: int
    objective: float
    values: Floats
    step: float
    counts: Counts
    note: str = ""


@dataclass(frozen=True)
class Grid:
    """The discrepancy over one or two parameters.

    Args:
        names: the parameters of the axes.
        axes: for every axis its values (k,), SI.
        objective: (len(axes[0]), ...) discrepancy; infinite where the model has no solution.
    """

    names: tuple[str, ...]
    axes: tuple[Floats, ...]
    objective: Floats


@dataclass(frozen=True)
class FieldSeries:
    """The state of the whole mesh, stage by stage, the virgin state first.

    Args:
        mesh: the mesh.
        displacement: (n_states, n_nodes, dim), m; 0 at nodes that are absent.
        stress: (n_states, n_elements, 6) mean stress of each element, xx yy zz xy yz xz, Pa;
            NaN in absent elements.
        present: (n_states, n_elements).
        yielded: (n_states, n_elements).
    """

    mesh: Mesh
    displacement: Floats
    stress: Floats
    present: Bools
    yielded: Bools


@dataclass(frozen=True)
class MemberForces:
    """Forces in linings and bolts, NaN while a structure does not stand.

    Args:
        structures: (n_members,) name of the structure of each straight piece.
        numbers: (n_members,) its number within the structure, from 1.
        stages: names of the stages, the virgin state not among them.
        ends: (n_members, 2, dim) its two ends, m.
        axial: (n_members, n_stages) N, tension positive: N per metre of a lining, N of one bolt.
        moment: (n_members, 2, n_stages) M at the two ends, N m per metre, positive with tension on
            the open side (from first to second end: on the right); NaN for bolts.
        shear: (n_members, n_stages) Q = dM/ds, N per metre; NaN for bolts.
        per_metre: (n_members,) it is a lining.
    """

    structures: tuple[str, ...]
    numbers: Ints
    stages: tuple[str, ...]
    ends: Floats
    axial: Floats
    moment: Floats
    shear: Floats
    per_metre: Bools


@dataclass(frozen=True)
class Provenance:
    """Where a result comes from. ``identity`` is the hash of everything that it depends on."""

    command: str
    versions: Mapping[str, str]
    seed: int
    case_file: str
    case_sha256: str
    mesh_sha256: str
    readings_sha256: str
    identity: str
    created: str


@dataclass(frozen=True)
class Result:
    """All that ``geoident fit``, ``predict``, ``simulate`` or ``scan`` found.

    Args:
        kind: the command, ``fit``, ``predict``, ``simulate`` or ``scan``.
        status: ``converged``, ``not-converged``, ``not-determined``, ``out-of-budget``, ``done``.
        exit_code: of the command.
        method: names of the methods of the chain, joined by `` + ``.
        reason: why it stopped, one sentence with the remedy where there is one.
        objective: what was minimised, with the prior's part, at the estimate; NaN if none. The
            plain weighted squares, unless the loss is robust: those are in ``diagnostics``.
        findings: sentences on what is not determined and which directions only the prior fixes.
        case_text: the case verbatim.
        case_resolved: the same with overrides applied, as YAML.
        parameters, gauges, prediction, history, grid, fields, counts: see their types.
        sensitivity: (n_channels, n_stages, n) derivative of the computed readings, or None.
        diagnostics: how each reading bears on the answer of a fit, or None.
        members: forces in linings and bolts, or None if there are none.
        certificate: what an identification of yield limits can say for itself, or None.
    """

    kind: str
    status: str
    exit_code: int
    method: str
    reason: str
    objective: float
    findings: tuple[str, ...]
    case_text: str
    case_resolved: str
    provenance: Provenance
    parameters: ParameterTable
    gauges: GaugeTable
    counts: Counts
    sensitivity: Floats | None = None
    prediction: Prediction | None = None
    history: tuple[Iteration, ...] = ()
    grid: Grid | None = None
    fields: FieldSeries | None = None
    singular_values: Floats | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)
    diagnostics: Diagnostics | None = None
    members: MemberForces | None = None
    certificate: Certificate | None = None
