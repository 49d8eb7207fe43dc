"""A reduced model to arrays and back: what a result keeps of it (theory 14.7).

The arrays are named by what they are and by what they are about: ``matrices 3 2 0`` are those of
the work of state 2 on state 3 in material 0. Materials, gauges and what these add by themselves
come from the case; nothing is needed of the mesh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.forward.checks import inadmissible_numbers
from geoident.forward.gauges.instrument_errors import InstrumentErrors, ReadingPlaces
from geoident.forward.gauges.zeros import ReadingRule
from geoident.forward.reduced.affine_analysis import AffineForm
from geoident.forward.reduced.loads import LoadForm
from geoident.forward.reduced.model import ReducedModel
from geoident.forward.reduced.moduli import Span, material_moduli, rigidity_moduli
from geoident.forward.reduced.projection import ReducedStage, ZoneResidual
from geoident.forward.reduced.response import Gauged, ReducedResponse
from geoident.forward.reduced.stress_rows import StageForces
from geoident.forward.reduced.zones import StressTerm, rigidity_name
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.results.reduced import FORM, KeptReducedModel


def kept_model(
    reduced: ReducedResponse, gauged: Gauged, analyses: Sequence[Floats]
) -> KeptReducedModel:
    """The arrays of a reduced model.

    Args:
        reduced: the model.
        gauged: the model on the mesh of which it is.
        analyses: (n,) parameters of which it was made.

    Raises:
        ValueError: nothing is known of the errors of its readings.
    """
    if not len(reduced.ratios):
        msg = "a reduced model that knows nothing of the errors of its readings is not kept"
        raise ValueError(msg)
    model, rule, parameters = reduced.model, gauged.rule, gauged.case.parameters
    return KeptReducedModel(
        form=FORM,
        names=model.form.names,
        reference=model.reference,
        lower=np.array([q.lower for q in parameters]),
        upper=np.array([q.upper for q in parameters]),
        analyses=np.array(analyses).reshape(-1, len(model.form.names)),
        materials=tuple(model.form.spans),
        channels=rule.channels,
        weights=rule.weights,
        zero=rule.zero,
        readable=rule.readable,
        built_on=gauged.built_on,
        rows=reduced.rows,
        states=reduced.states,
        blocks=_blocks_of(model, reduced.ratios),
    )


def _blocks_of(model: ReducedModel, ratios: Floats) -> dict[str, Floats]:
    """Name to array; `_Blocks` reads them."""
    blocks: dict[str, Floats] = {}
    number = {name: n for n, name in enumerate(model.form.spans)}

    def add(kind: str, array: Floats | Ints | float, *about: int) -> None:
        name = " ".join((kind, *map(str, about)))
        blocks[name] = np.array(array, dtype=np.float64, order="C")

    def add_terms(kind: str, terms: Mapping[StressTerm, Floats], *about: int) -> None:
        for (state, material), array in terms.items():
            add(kind, array, *about, state, number[material])

    for n, span in enumerate(model.form.spans.values()):
        add("basis", span.basis, n)
        if span.fixed is not None:
            add("fixed", span.fixed, n)
    loads = model.form.loads
    add("scale", loads.scale)
    add("exponents", loads.exponents)
    add("mix", loads.mix)
    add("settles", float(loads.settles))
    add("ratios", ratios)
    for n, stage in enumerate(model.stages):
        add("base", stage.base, n)
        add("observed", stage.observed, n)
        add("load", stage.load, n)
        add_terms("matrices", stage.matrices, n)
        changes = [[number[m] for m in change] for change in stage.changes]
        add("changes", np.array(changes).reshape(-1, 2), n)
        add("force-channels", stage.forces.channels, n)
        add("force-loads", stage.forces.loads, n)
        add_terms("force-terms", stage.forces.terms, n)
        for place, zone in enumerate(stage.residuals):
            add("zone", number[zone.material], n, place)
            add("zone-loads", zone.loads, n, place)
            add("zone-rest", zone.rest, n, place)
            add_terms("zone-terms", zone.terms, n, place)
    return blocks


class _Blocks:
    """Arrays of a kept model by kind and by what they are about."""

    def __init__(self, kept: KeptReducedModel) -> None:
        self._materials = kept.materials
        self._of_kind: dict[str, dict[tuple[int, ...], Floats]] = {}
        for name, block in kept.blocks.items():
            kind, *about = name.split(" ")
            self._of_kind.setdefault(kind, {})[tuple(map(int, about))] = block

    def one(self, kind: str, *about: int) -> Floats:
        return self._of_kind[kind][about]

    def get(self, kind: str, *about: int) -> Floats | None:
        return self._of_kind.get(kind, {}).get(about)

    def terms(self, kind: str, *about: int) -> dict[StressTerm, Floats]:
        """By state and material."""
        return {
            (key[-2], self._materials[key[-1]]): block
            for key, block in self._of_kind.get(kind, {}).items()
            if key[:-2] == about
        }

    def stage(self, n: int) -> ReducedStage:
        zones: list[ZoneResidual] = []
        while (material := self.get("zone", n, len(zones))) is not None:
            place = len(zones)
            zones.append(
                ZoneResidual(
                    self._materials[int(material)],
                    self.one("zone-loads", n, place),
                    self.one("zone-rest", n, place),
                    self.terms("zone-terms", n, place),
                )
            )
        changes = self.one("changes", n).astype(np.int64).tolist()
        return ReducedStage(
            base=int(self.one("base", n)),
            observed=self.one("observed", n),
            matrices=self.terms("matrices", n),
            load=self.one("load", n),
            residuals=tuple(zones),
            changes=tuple((self._materials[a], self._materials[b]) for a, b in changes),
            forces=StageForces(
                self.one("force-channels", n).astype(np.int64),
                self.one("force-loads", n),
                self.terms("force-terms", n),
            ),
        )


@dataclass(frozen=True)
class _Made:
    """Materials of which there is ground in any state, as `checks.MadeOf`."""

    materials: tuple[str, ...]


class RestoredModel:
    """A kept reduced model with its case: readings at any parameters, and how far they may be off.

    Args:
        kept: the arrays.
        case: of which they are; what computes is the same as where they were made.

    Attributes:
        model: the reduced model.
        rule: how readings are made of what channels see.
        instrument_errors: what gauges add by themselves.
        bases: (n_states,) the state on which each builds.
        built_on: (n_states, n_states) see `ConstructionSequence.built_on`.
    """

    def __init__(self, kept: KeptReducedModel, case: Case) -> None:
        self.kept, self.case, self.built_on = kept, case, kept.built_on
        self._blocks = blocks = _Blocks(kept)
        states = [n for n in range(len(kept.readable)) if blocks.get("base", n) is not None]
        stages = tuple(map(blocks.stage, states))
        loads = LoadForm(
            scale=blocks.one("scale"),
            exponents=blocks.one("exponents").astype(np.int64),
            mix=blocks.one("mix"),
            stress=np.zeros((0, 0, len(blocks.one("mix")))),
            forces=(),
            settles=bool(blocks.one("settles")),
        )
        self.model = ReducedModel(
            AffineForm(kept.names, self._spans(), loads), kept.reference, stages
        )
        self.rule = ReadingRule(kept.channels, kept.zero, kept.weights, kept.readable)
        self._ground = _Made(tuple(m for m in kept.materials if m in case.materials))
        self.instrument_errors = InstrumentErrors(case, kept.built_on)
        self.bases = np.arange(len(kept.readable))
        self.bases[states] = [stage.base for stage in stages]
        self._place = {
            (kept.channels[row], case.stage_names[state]): n
            for n, (row, state) in enumerate(zip(kept.rows, kept.states, strict=True))
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self.kept.names

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Channels and stages of all readings that it gives."""
        return tuple(self._place)

    def _spans(self) -> dict[str, Span]:
        case, names = self.case, self.kept.names
        structures = {
            rigidity_name(name, number): (structure, number)
            for name, structure in case.structures.items()
            for number in range(4)
        }
        spans = {}
        for n, name in enumerate(self.kept.materials):
            basis = self._blocks.one("basis", n)
            s = basis.shape[1]
            if name in case.materials:
                moduli = material_moduli(case.materials[name], names, s)
            else:
                structure, number = structures[name]
                moduli = rigidity_moduli(structure, names, s, number=number)
            spans[name] = Span(name, moduli, basis, self._blocks.get("fixed", n))
        return spans

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is not answered, or None: it is impossible, or beyond the bounds."""
        if not np.all(np.isfinite(p)):
            return "a parameter is not finite"
        kept = self.kept
        tolerance = 1e-9 * (kept.upper - kept.lower)
        for name, value, low, high in zip(
            kept.names, p, kept.lower - tolerance, kept.upper + tolerance, strict=True
        ):
            if not low <= value <= high:
                return f"{name} is beyond the bounds with which the reduced model was made"
        values = dict(zip(kept.names, map(float, p), strict=True))
        return inadmissible_numbers(self.case, self._ground, values)

    def covers(self, pairs: Sequence[tuple[str, str]]) -> bool:
        """Whether it gives the readings of some channels at some stages."""
        return all(pair in self._place for pair in pairs)

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> ReducedResponse:
        """Readings of some channels at some stages, with estimates of their errors.

        Args:
            pairs: their channels and stages.
            times: when each is read; empty for what is known of the stages.

        Raises:
            KeyError: it does not give one of them, see `covers`.
        """
        some = np.array([self._place[pair] for pair in pairs], dtype=np.int64)
        places = ReadingPlaces.of(self.case, pairs, times)
        return ReducedResponse(self.model, self, places, self._blocks.one("ratios")[some])
