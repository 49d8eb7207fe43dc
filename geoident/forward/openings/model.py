"""A circular opening as a model: of a case without mesh, or a first estimate beside the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoident.errors import InputError, ModelError
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.gauges.zeros import ReadingRule
from geoident.forward.observed import Details, Observed, ObservedModel, ObservedResponse, Query
from geoident.forward.openings.face import (
    FaceState,
    advance_of,
    conversion_note,
    face_at,
    face_note,
    face_states,
)
from geoident.forward.openings.field import NO_SECTION, OpeningField, unsuitable
from geoident.forward.openings.reaction import ground_reaction
from geoident.forward.openings.site import Circle, OpeningSite, site_in_mesh, site_without_mesh
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Analysis, Case
from geoident.model.mesh import Mesh
from geoident.model.parameter import Values

_NO_MESH = Mesh(np.empty((0, 2)), ())


class OpeningModel(ObservedModel):
    """The closed form of a case.

    Args:
        on_mesh: the case, on its mesh or on one without elements.
        site: where the opening is.
    """

    def __init__(self, on_mesh: CaseOnMesh, site: OpeningSite) -> None:
        case, sequence = on_mesh.case, on_mesh.sequence
        self.sequence = sequence
        self._on_mesh = on_mesh
        self._face = face_at(on_mesh, site.centre, site.ground)
        self.field = OpeningField(on_mesh, site, self._face)
        zero = np.array([case.zero_of(channel) for channel in case.channels], np.int64)
        covered, columns = self.field.covered, np.arange(len(zero))
        weights = np.repeat([[1.0], [-1.0]], len(zero), axis=1)
        channels = tuple(channel.name for channel in case.channels)
        since_zero = covered & covered[zero, columns] & (np.arange(len(covered))[:, None] >= zero)
        rule = ReadingRule(channels, zero, weights, since_zero)
        super().__init__(case, rule, sequence.built_on, sequence.bases)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood."""
        return (*self.field.notes(self.case.start), *conversion_note(self._face, self._on_mesh))

    def face_states(self, values: Values) -> tuple[FaceState, ...]:
        """What distances to the face become at some parameters; see `face_states`."""
        return face_states(self._face, self._on_mesh, values)

    def domain_fault(self, p: Floats) -> str | None:
        """Why finite p (n,) is outside the domain, or None."""
        return self.field.admissible(self.values(p))

    def why_unseen(self, state: int, row: int) -> str:
        """Why a channel has no closed form between its zero and a state, a clause."""
        reasons = (self.field.why_uncovered(n, row) for n in (int(self.rule.zero[row]), state))
        return next(reason for reason in reasons if reason is not None)

    def observe(self, p: Floats, query: Query) -> Observed:
        """What all channels see at p (n,) in closed form.

        Raises:
            ModelError: a stage that is needed has no equilibrium, or none in closed form, unless
                ``query.partial``.
        """
        self.evaluations += 1
        values, names = self.values(p), self.names if query.derivatives else ()
        places, failures, others = query.places, list[ModelError](), list[ModelError]()
        needed = {*places.states.tolist(), *self.rule.zero[places.rows].tolist()}
        seen = self.field.observed(
            values, names, wanted=needed, failures=failures if query.partial else None
        )
        rest = [n for n in range(len(seen)) if n not in needed]
        seen[rest] = self.field.observed(values, names, wanted=rest, failures=others)[rest]
        details = Details()
        if query.survey:
            details = replace(details, notes=face_note(self._face, self._on_mesh, values))
        if query.fields:
            details = replace(
                details,
                reaction=ground_reaction(self.field, values),
                advance=advance_of(self._face, self._on_mesh, values),
            )
        return Observed(seen, None, tuple(failures), details)

    def increments_of(self, observed: Observed) -> Floats:
        """What the step of each state changes in what channels see, (n_states, n_channels), m.

        0 where there is no closed form; also before the zero of a channel.
        """
        seen = observed.seen[..., 0]
        known = self.field.covered & np.isfinite(seen)
        seen = np.where(known, seen, 0.0)
        return np.where(known, seen - seen[self.bases], 0.0)

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> OpeningResponse:
        """The response in the readings of some (channel, stage) pairs."""
        return OpeningResponse(self, ReadingPlaces.of(self.case, pairs, times))


class OpeningResponse(ObservedResponse[OpeningModel]):
    """Readings of some channels at some stages in closed form; only those that have one.

    Args:
        model: the closed form of the case.
        places: what was read, where and when.

    Attributes:
        covered: (g,) which of the readings have a closed form; the response consists of these.
    """

    def __init__(self, model: OpeningModel, places: ReadingPlaces) -> None:
        self.covered: Bools = model.rule.readable[places.states, places.rows]
        super().__init__(model, places.only(self.covered))

    def remarks(self, p: Floats) -> tuple[str, ...]:
        """What is to be known of the closed form at p (n,)."""
        return self._model.field.remarks(self._model.values(p))

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningResponse | str:
        """Itself: the model is the closed form, of the opening that the case gives."""
        return self


def opening_model(case: Case) -> OpeningModel:
    """The closed form of a case that has no mesh.

    Raises:
        InputError: it has none.
    """
    on_mesh, given = CaseOnMesh(case, _NO_MESH), case.fit.closed_form
    found = site_without_mesh(on_mesh.sequence, Circle(given.centre, given.radius))
    model = found if isinstance(found, str) else _model_or_reason(on_mesh, found)
    if isinstance(model, str):
        message = f"there is no closed form of this case: {model}"
        place = ("fit", "closed-form")
        raise InputError([case.source.fault(place, code="no-closed-form", message=message)])
    return model


def opening_in_mesh(on_mesh: CaseOnMesh, circle: Circle) -> OpeningModel | str:
    """The closed form of a case that has a mesh, or why there is none, a clause.

    Args:
        on_mesh: the case on its mesh.
        circle: what the case says of the opening.
    """
    if on_mesh.case.analysis is not Analysis.PLANE_STRAIN:
        return NO_SECTION
    found = site_in_mesh(on_mesh, circle)
    return found if isinstance(found, str) else _model_or_reason(on_mesh, found)


def _model_or_reason(on_mesh: CaseOnMesh, site: OpeningSite) -> OpeningModel | str:
    material = on_mesh.sequence.states[0].materials[site.ground]
    if on_mesh.case.materials[material].fields:
        return f"constants of '{material}' vary from place to place"
    why = unsuitable(on_mesh.case, material, has_mesh=on_mesh.mesh is not _NO_MESH)
    return OpeningModel(on_mesh, site) if why is None else why
