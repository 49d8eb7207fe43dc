"""A case on its mesh, ready to answer: the one class by which others use the forward model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from geoident.errors import Fault, InputError
from geoident.fem.solvers import Solver
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.analysis.fields import MeshRecorder
from geoident.forward.analysis.virgin import (
    contradictions,
    overburden_notes,
    surface_gaps,
    water_notes,
)
from geoident.forward.checks import check_on_mesh, imbalance_notes, notes_on_mesh
from geoident.forward.ground.field import field_notes, point_field, with_modes
from geoident.forward.in_situ.growth import growth_notes, point_growths, start_faults
from geoident.forward.openings.face import FaceState, conversion_note, face_states
from geoident.forward.reducible import ReducibleResponse
from geoident.forward.staged import StagedKernel
from geoident.forward.stages import CaseOnMesh
from geoident.forward.yielding.hoek_brown import equivalent_notes
from geoident.forward.yielding.varied import strength_faults
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.dual import ParameterPoint
from geoident.model.mesh import Mesh
from geoident.model.parameter import Values
from geoident.model.results.result import FieldSeries


def staged_model(mesh: Mesh, case: Case, *, solver: Solver) -> StagedModel:
    """The staged forward model of a case on a mesh, after all checks.

    Args:
        mesh: its mesh.
        case: the case.
        solver: factorizes the stiffness matrices.

    Raises:
        InputError: everything in the case that does not fit the mesh, at once.
        ModelError: a piece of the ground that no support holds.
    """
    on_mesh, gauges = check_on_mesh(case, mesh)
    return StagedModel(with_fields(on_mesh), gauges, solver=solver)


def with_fields(on_mesh: CaseOnMesh) -> CaseOnMesh:
    """A case on its mesh with its fields there, and their modes among its parameters.

    What grows with depth or stress is there, too.

    Raises:
        InputError: a constant that grows is not admissible somewhere at the start values.
    """
    case, positions = on_mesh.case, on_mesh.discretization.points.position
    fields = []
    for field in case.fields:
        points = on_mesh.material_points(field.material)
        fields.append(point_field(field, points, positions[points], case.start))
    growths = point_growths(on_mesh)
    if faults := start_faults(case, growths):
        raise InputError(faults)
    if not fields and not growths:
        return on_mesh
    varied = on_mesh.with_fields(with_modes(case, fields), tuple(fields), growths)
    if faults := strength_faults(varied):
        raise InputError(faults)
    return varied


class StagedModel(StagedKernel):
    """`StagedKernel` plus notes and the reduced model; `staged_model` gives one that is checked.

    Args:
        on_mesh: the case and the mesh that it fits.
        gauges: those of the case, on its mesh.
        solver: factorizes the stiffness matrices.
    """

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood."""
        start = self.case.start
        unknowns = self.systems[0].dofs
        noted = notes_on_mesh(
            self.on_mesh,
            self.gauges,
            edges_held=self.actions.hold_edges(ParameterPoint(start, ()), unknowns),
            n_outside=max(
                self.analysis.n_outside,
                self.actions.n_outside,
                *(growth.n_outside for growth in self.on_mesh.growths),
            ),
            in_tension=self.analysis.virgin_tension(start)
            and not water_notes(self.analysis, start),
        )
        varied = field_notes(self.on_mesh.case, self.on_mesh.fields)
        growing = growth_notes(self.on_mesh.growths, self.case.start)
        return (*noted, *conversion_note(self.face, self.on_mesh), *varied, *growing)

    def face_states(self, values: Values) -> tuple[FaceState, ...]:
        """What distances to the face become at some parameters; see `openings.face`."""
        return face_states(self.face, self.on_mesh, values)

    def virgin_notes(self) -> tuple[str, ...]:
        """What to know of the in-situ stress at the start values; nothing is factorized."""
        start = self.case.start
        stress, imbalance = self.analysis.virgin(ParameterPoint(start, ()))
        return (
            *self._equivalent_notes(stress[..., 0]),
            *overburden_notes(self.analysis, start),
            *water_notes(self.analysis, start),
            *imbalance_notes(float(imbalance[0])),
            *(self.contradiction_notes(start) if self.case.imbalance_accepted else ()),
        )

    def _equivalent_notes(self, stress: Floats) -> Iterator[str]:
        """Curved strengths as c and phi, in the in-situ stress (n_strain, n_points)."""
        for name, points in self.systems[0].points_of.items():
            if self.on_mesh.strength_growths(name):  # another curve at each point
                continue
            material = self.case.materials[name]
            yield from equivalent_notes(material, stress[:, points], self.case.start)

    def contradictions(self) -> list[Fault]:
        """Where weight and in-situ stress disagree at the start values, unless that is accepted.

        Nothing is factorized.
        """
        gaps = surface_gaps(self.analysis, self.case.start)
        if gaps or self.case.imbalance_accepted:
            return gaps
        return contradictions(self.analysis, self.case.start)

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> ReducibleResponse:
        """The response in the readings of some (channel, stage) pairs.

        Args:
            pairs: what was read.
            times: when each was read, seconds since 1970; None for what is known of its stage.
        """
        return ReducibleResponse(self, pairs, times)

    def fields_up_to_collapse(self, p: Floats) -> FieldSeries:
        """The states that do not build on a stage that collapses; what is known of the others.

        Args:
            p: (n,) parameters.
        """
        recorder = MeshRecorder(self.on_mesh, self.structures)
        options = RunOptions(derivatives=False, partial=True)
        for end in self.at(p, options).states():
            recorder.add(end)
        return recorder.fields.series()
