"""A reduced model to arrays and back: what a result keeps of it (theory 14.7).

The arrays are named by what they are and by what they are about: ``matrices 3 2 0`` are those of
the work of state 2 on state 3 in material 0. Materials, gauges and what these add by themselves
come from the case; nothing is needed of the mesh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from geoident.forward.checks import inadmissible_numbers
from geoident.forward.gauges.instrument_errors import InstrumentErrors, ReadingPlaces
from geoident.forward.gauges.observation import Observation
from geoident.forward.reduced.affine_analysis import AffineForm
from geoident.forward.reduced.loads import LoadForm
from geoident.forward.reduced.model import ReducedModel
from geoident.forward.reduced.moduli import MaterialSpan, RigiditySpan, Span
from geoident.forward.reduced.projection import ReducedStage, ZoneResidual
from geoident.forward.reduced.response import ReadingsAsked, ReducedResponse
from geoident.forward.reduced.stress_rows import StageForces
from geoident.forward.reduced.zones import StressTerm, rigidity_name
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.results.reduced import FORM, KeptReducedModel

_Key = TypeVar("_Key", str, StressTerm)


def kept_model(
    reduced: ReducedResponse,
    observation: Observation,
    case: Case,
    *,
    analyses: Sequence[Floats],
    built_on: Bools,
) -> KeptReducedModel:
    """The arrays of a reduced model.

    Args:
        reduced: the model.
        observation: the gauges of the case.
        case: of which it is.
        analyses: (n,) parameters of which it was made.
        built_on: (n_states, n_states) see `ConstructionSequence.built_on`.

    Raises:
        ValueError: nothing is known of the errors of its readings.
    """
    if not len(reduced.ratios):
        msg = "a reduced model that knows nothing of the errors of its readings is not kept"
        raise ValueError(msg)
    model = reduced.model
    materials = tuple(model.form.spans)
    packed = _Packed(materials)
    packed.moduli(model.form.spans)
    packed.loads(model.form.loads)
    packed.ratios(reduced.ratios)
    for number, stage in enumerate(model.stages):
        packed.stage(number, stage)
    return KeptReducedModel(
        form=FORM,
        names=model.form.names,
        reference=model.reference,
        lower=np.array([q.lower for q in case.parameters]),
        upper=np.array([q.upper for q in case.parameters]),
        analyses=np.array(analyses).reshape(-1, len(model.form.names)),
        materials=materials,
        channels=observation.channels,
        weights=observation.weights,
        zero=observation.zero,
        readable=observation.readable,
        built_on=built_on,
        rows=reduced.rows,
        states=reduced.states,
        blocks=packed.blocks,
    )


class _Packed:
    """Arrays by name."""

    def __init__(self, materials: Sequence[str]) -> None:
        self.blocks: dict[str, Floats] = {}
        self._number = {name: n for n, name in enumerate(materials)}

    def _add(self, kind: str, array: Floats | Ints | float, *about: int) -> None:
        name = " ".join((kind, *map(str, about)))
        self.blocks[name] = np.array(array, dtype=np.float64, order="C")

    def _add_all(self, kind: str, arrays: Mapping[_Key, Floats], *about: int) -> None:
        """Arrays by material, or by state and material."""
        for key, array in arrays.items():
            if isinstance(key, str):
                self._add(kind, array, *about, self._number[key])
            else:
                self._add(kind, array, *about, key[0], self._number[key[1]])

    def moduli(self, spans: Mapping[str, Span]) -> None:
        for name, span in spans.items():
            number = self._number[name]
            if isinstance(span, MaterialSpan):
                self._add("section", float(span.section), number)
            else:
                self._add("bending", float(span.bending), number)
            self._add("basis", span.basis, number)
            if span.fixed is not None:
                self._add("fixed", span.fixed, number)

    def loads(self, form: LoadForm) -> None:
        self._add("scale", form.scale)
        self._add("exponents", form.exponents)
        self._add("mix", form.mix)
        self._add("settles", float(form.settles))

    def ratios(self, ratios: Floats) -> None:
        self._add("ratios", ratios)

    def stage(self, number: int, stage: ReducedStage) -> None:
        self._add("base", stage.base, number)
        self._add("observed", stage.observed, number)
        self._add("load", stage.load, number)
        self._add_all("matrices", stage.matrices, number)
        self._add_all("normal", stage.normal, number)
        changes = [[self._number[m] for m in change] for change in stage.changes]
        self._add("changes", np.array(changes).reshape(-1, 2), number)
        self._add("force-channels", stage.forces.channels, number)
        self._add("force-loads", stage.forces.loads, number)
        self._add_all("force-terms", stage.forces.terms, number)
        for place, zone in enumerate(stage.residuals):
            self._add("zone", self._number[zone.material], number, place)
            self._add("zone-loads", zone.loads, number, place)
            self._add("zone-rest", zone.rest, number, place)
            self._add_all("zone-terms", zone.terms, number, place)


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

    def whole(self, kind: str, *about: int) -> int:
        return int(self.one(kind, *about))

    def get(self, kind: str, *about: int) -> Floats | None:
        return self._of_kind.get(kind, {}).get(about)

    def materials(self, kind: str, *about: int) -> dict[str, Floats]:
        """By material."""
        blocks = self._about(kind, about)
        return {self._materials[key[0]]: block for key, block in blocks}

    def terms(self, kind: str, *about: int) -> dict[StressTerm, Floats]:
        """By state and material."""
        blocks = self._about(kind, about)
        return {(key[0], self._materials[key[1]]): block for key, block in blocks}

    def _about(self, kind: str, about: tuple[int, ...]) -> list[tuple[tuple[int, ...], Floats]]:
        blocks = self._of_kind.get(kind, {})
        return [(k[len(about) :], b) for k, b in blocks.items() if k[: len(about)] == about]

    def stage(self, number: int) -> ReducedStage:
        zones: list[ZoneResidual] = []
        while (material := self.get("zone", number, len(zones))) is not None:
            place = len(zones)
            zones.append(
                ZoneResidual(
                    self._materials[int(material)],
                    self.one("zone-loads", number, place),
                    self.one("zone-rest", number, place),
                    self.terms("zone-terms", number, place),
                )
            )
        changes = self.one("changes", number).astype(np.int64).tolist()
        return ReducedStage(
            self.whole("base", number),
            self.one("observed", number),
            self.terms("matrices", number),
            self.one("load", number),
            tuple(zones),
            self.materials("normal", number),
            tuple((self._materials[a], self._materials[b]) for a, b in changes),
            StageForces(
                self.one("force-channels", number).astype(np.int64),
                self.one("force-loads", number),
                self.terms("force-terms", number),
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
        instrument_errors: what gauges add by themselves.
    """

    def __init__(self, kept: KeptReducedModel, case: Case) -> None:
        self.kept, self.case = kept, case
        self._blocks = blocks = _Blocks(kept)
        states = range(len(kept.readable))
        self.model = ReducedModel(
            AffineForm(kept.names, self._spans(), self._loads()),
            kept.reference,
            tuple(blocks.stage(n) for n in states if blocks.get("base", n) is not None),
        )
        self._observation = Observation(
            kept.channels, kept.zero, kept.weights, kept.readable, (), ("",) * len(kept.channels)
        )
        spans = self.model.form.spans
        self._ground = _Made(tuple(m for m in spans if isinstance(spans[m], MaterialSpan)))
        self.instrument_errors = InstrumentErrors(case, kept.built_on)
        self._dimensions = {channel.name: channel.dimension for channel in case.channels}
        self._bases = np.arange(len(kept.readable))
        self._bases[: len(self.model.stages)] = [stage.base for stage in self.model.stages]
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

    @property
    def bases(self) -> Ints:
        """(n_states,) the state on which each builds."""
        return self._bases

    @property
    def observation(self) -> Observation:
        """The gauges, without their places on the mesh."""
        return self._observation

    def _spans(self) -> dict[str, Span]:
        blocks, names = self._blocks, self.kept.names
        structures = {
            rigidity_name(name, bending): structure
            for name, structure in self.case.structures.items()
            for bending in (False, True)
        }
        spans: dict[str, Span] = {}
        for n, name in enumerate(self.kept.materials):
            basis, fixed = blocks.one("basis", n), blocks.get("fixed", n)
            bending = blocks.get("bending", n)
            if bending is None:
                section = bool(blocks.one("section", n))
                material = self.case.materials[name]
                spans[name] = MaterialSpan(material, names, section, basis, fixed)
            else:
                spans[name] = RigiditySpan(structures[name], bool(bending), names, basis, fixed)
        return spans

    def _loads(self) -> LoadForm:
        blocks = self._blocks
        exponents = blocks.one("exponents").astype(np.int64)
        nothing = np.zeros((0, 0, len(blocks.one("mix"))))
        return LoadForm(
            blocks.one("scale"),
            exponents,
            blocks.one("mix"),
            nothing,
            (),
            bool(blocks.one("settles")),
        )

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
        kept = self.kept
        values = dict(zip(kept.names, map(float, kept.reference), strict=True))
        places = ReadingPlaces.of(self.case, pairs, times)
        asked = ReadingsAsked(
            kept.rows[some],
            kept.states[some],
            self.instrument_errors.added(values, kept.names, places),
            [self._dimensions[channel] for channel in kept.channels],
        )
        ratios = self._blocks.one("ratios")[some]
        return ReducedResponse(
            self.model, self._observation, asked, self._bases, self.admissible, ratios
        )
