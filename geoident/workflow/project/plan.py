"""From a project file to its sections: what is read, what is wrong with them, what is known."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from geoident.errors import Fault, InputError
from geoident.io.project.file import FaultyProject, read_project
from geoident.io.result.file import PROJECT_FORMAT
from geoident.io.text.faults import OVERRIDES, shortened
from geoident.io.text.overrides import parse_path
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.yaml_reader import MAX_BYTES
from geoident.model.case import Case, KeyPath, format_path
from geoident.model.methods import SquaredOptions
from geoident.model.parameter import Parameter
from geoident.model.project.project import ParameterLaw, Project, ProjectSection
from geoident.units import DIMENSIONLESS, shown_unit, with_article
from geoident.workflow.running.jobs import Inputs, load_inputs, sha256
from geoident.workflow.running.outputs import (
    Existing,
    Target,
    existing,
    require_free,
    stamp,
    target,
)

COMMAND = "fit"
LEAVE_ONE_OUT = "leave-one-out"


@dataclass(frozen=True)
class ProjectRequest:
    """A project and what to do with it.

    Args:
        path: of its file.
        output: a file or an existing folder; None for beside the project.
        leave_one_out: predict each section from the others, too.
        solver: name of the sparse solver, or ``auto``.
        jobs: sections to compute at a time; None for the cores there are.
        seed: of random numbers.
        force: overwrite a result of other input.
        fresh: compute again what is up to date, and forget the checkpoint.
    """

    path: str
    output: str | None = None
    leave_one_out: bool = False
    solver: str = "auto"
    jobs: int | None = None
    seed: int = 0
    force: bool = False
    fresh: bool = False


@dataclass(frozen=True)
class ProjectJob:
    """A project that was read, and where its result goes.

    Args:
        request: what was asked for.
        project: what its file says.
        text: of the file.
        inputs: the case of each section.
        place: of the result.
        identity: hash of everything that the result depends on.
        found: what stands at the place of the result.
        stamp: of the files as they were read.
        started: when it was planned, by the clock that counts seconds.
    """

    request: ProjectRequest
    project: Project
    text: str
    inputs: tuple[Inputs, ...]
    place: Target
    identity: str
    found: Existing
    stamp: str
    started: float = field(default_factory=time.monotonic)

    @property
    def up_to_date(self) -> bool:
        """The result stands there already and is to be kept."""
        return self.found is Existing.UP_TO_DATE and not self.request.fresh

    @property
    def files(self) -> tuple[str, ...]:
        """Paths of all that is read, which no output may replace."""
        named = (path for one in self.inputs for path in one.files)
        return tuple(dict.fromkeys((self.project.path, *named)))


def plan_project(request: ProjectRequest) -> ProjectJob:
    """Read a project and the cases of its sections, and look at what stands where its result goes.

    Raises:
        InputError: with all faults of the project, or else of the cases of its sections, or of what
            they have in common.
        OutputError: the result could not be written, or another one would be lost.
    """
    project, inputs = read_sections(request.path)
    identity = _identity(project, inputs, request)
    place = target(request.path, COMMAND, output=request.output)
    found = existing(place, identity, kind=COMMAND, case=request.path)
    text = decode(read_bytes(request.path, limit=MAX_BYTES, what="project"), request.path)
    job = ProjectJob(request, project, text, inputs, place, identity, found, "")
    said = [LEAVE_ONE_OUT] if request.leave_one_out else []
    job = replace(job, stamp=stamp(place.path.parent, job.files, COMMAND, said, request.seed))
    if not job.up_to_date:
        require_free(found, place, force=request.force, inputs=job.files)
    return job


def read_sections(path: str) -> tuple[Project, tuple[Inputs, ...]]:
    """A project and the cases of its sections.

    Args:
        path: of the project.

    Raises:
        InputError: with all faults of the project, or else of the cases of its sections, or of what
            they have in common.
    """
    try:
        project = read_project(path)
    except FaultyProject as error:
        _, faults = _section_inputs(error.sound)
        raise InputError(in_order((*error.faults, *faults))) from error
    inputs, faults = _section_inputs(project.sections)
    faults += _common_faults(project, inputs)
    if faults:
        raise InputError(in_order(faults))
    return project, tuple(one for _, one in inputs)


def placed(error: InputError, section: ProjectSection) -> list[Fault]:
    """The faults of the case of a section where they are written: some in the project.

    Args:
        error: what is wrong with the case.
        section: of the project.
    """
    return [_placed(fault, section) for fault in error.faults]


def in_order(faults: Sequence[Fault]) -> list[Fault]:
    """Faults of several files, each once, in the order of the files."""
    once = {(fault.code, fault.message, fault.location): fault for fault in faults}
    found = sorted(
        once.values(), key=lambda f: (f.location.file, f.location.line, f.location.column)
    )
    return shortened(found)


def _identity(project: Project, inputs: Sequence[Inputs], request: ProjectRequest) -> str:
    said = {
        "format": PROJECT_FORMAT,
        "leave_one_out": request.leave_one_out,
        "shared": project.shared,
        "laws": [repr(replace(law, text="")) for law in project.laws],
        "sections": [
            [
                section.name,
                sorted(section.covariates.items()),
                section.predicted,
                one.identity(COMMAND, one.case.fit.methods, seed=request.seed),
            ]
            for section, one in zip(project.sections, inputs, strict=True)
        ],
    }
    return sha256(json.dumps(said, sort_keys=True).encode())


def _section_inputs(
    sections: Sequence[ProjectSection],
) -> tuple[list[tuple[ProjectSection, Inputs]], list[Fault]]:
    """The cases of the sections that are right, and the faults of the others."""
    inputs: list[tuple[ProjectSection, Inputs]] = []
    faults: list[Fault] = []
    for section in sections:
        try:
            inputs.append((section, load_inputs(section.case, overrides=section.overrides)))
        except InputError as error:
            faults += placed(error, section)
    return inputs, faults


def _placed(fault: Fault, section: ProjectSection) -> Fault:
    """A fault of a case where it is written: in the project, if its value comes from there."""
    from_there = fault.location.file == OVERRIDES
    for override, place in zip(section.overrides, section.places, strict=True):
        own = format_path(parse_path(override.partition("=")[0]))
        within = fault.path and own.startswith((f"{fault.path}.", f"{fault.path}["))
        if within or (from_there and (fault.path.startswith(own) or own.startswith(fault.path))):
            return replace(fault, location=place)
    return replace(fault, location=section.place) if from_there else fault


# Whether the sections have in common what the project says


def _common_faults(
    project: Project, inputs: Sequence[tuple[ProjectSection, Inputs]]
) -> Iterator[Fault]:
    first: dict[str, tuple[ProjectSection, Parameter]] = {}
    keys: dict[str, KeyPath] = {name: ("shared", n) for n, name in enumerate(project.shared)}
    keys |= {law.parameter: ("laws", law.parameter) for law in project.laws}
    for section, one in inputs:
        own = {q.name: q for q in one.case.parameters}
        yield from _not_covered(one.case, section)
        for name, key in keys.items():
            if name not in own:
                message = f"the case of the section '{section.name}' has no parameter '{name}'"
                known = ", ".join(own) or "none"
                yield Fault("unknown-parameter", message, f"Its parameters: {known}.",
                            project.place(*key), format_path(key))  # fmt: skip
                continue
            yield from _differs(one.case, section, own[name], first)
            first.setdefault(name, (section, own[name]))
        if section.predicted:
            yield from _loose(section, own, keys)
    for law in project.laws:
        if law.parameter in first:
            yield from _law_faults(project, law, first[law.parameter][1])


def _not_covered(case: Case, section: ProjectSection) -> Iterator[Fault]:
    """What a case has that a fit of several sections has no room for."""
    if case.fields:
        yield case.source.fault(
            ("materials",),
            code="not-of-a-project",
            message=f"the section '{section.name}' has constants that vary from place to place",
            hint="A section of a project has parameters alone: give the material one value.",
        )
    if not isinstance(case.fit.loss, SquaredOptions):
        yield case.source.fault(
            ("fit", "loss"),
            code="not-of-a-project",
            message=f"the section '{section.name}' has a robust loss",
            hint="Flag readings that are wrong as bad, or raise their accuracy.",
        )


def _differs(
    case: Case,
    section: ProjectSection,
    own: Parameter,
    first: Mapping[str, tuple[ProjectSection, Parameter]],
) -> Iterator[Fault]:
    """Whether a common parameter is declared as in the section before."""
    if own.name not in first:
        return
    other, known = first[own.name]
    for key, mine, theirs in (
        ("bounds", (own.lower, own.upper), (known.lower, known.upper)),
        ("scale", own.scale, known.scale),
        ("start", own.dimension, known.dimension),
        ("prior", own.prior, known.prior),
    ):
        if mine != theirs:
            what = {"start": "unit", "prior": "prior"}.get(key, key)
            message = f"the {what} of '{own.name}' differs from that of the section '{other.name}'"
            path = ("parameters", own.name, key)
            located = case.source.locate(path)
            place = section.place if located.file == OVERRIDES else located
            hint = "A parameter that is shared or has a law is declared alike in all sections."
            yield Fault("differing-parameter", message, hint, place, format_path(path))


def _loose(
    section: ProjectSection, own: Mapping[str, Parameter], keys: Mapping[str, object]
) -> Iterator[Fault]:
    for name, parameter in own.items():
        if name not in keys and parameter.prior is None:
            message = f"nothing tells '{name}' of the section '{section.name}', which is predicted"
            hint = "Share it, give it a law or a prior, or write its value in place of it."
            yield Fault("nothing-known", message, hint, section.place)


def _law_faults(project: Project, law: ParameterLaw, parameter: Parameter) -> Iterator[Fault]:
    key = ("laws", law.parameter)
    scatter = law.scatter
    expected = DIMENSIONLESS if parameter.scale == "log" else parameter.dimension
    if scatter.kind == "given" and scatter.dimension != expected:
        message = f"the scatter is {with_article(scatter.dimension)}; of '{law.parameter}' "
        message += f"(scale: {parameter.scale}) {with_article(expected)} is expected"
        hint = "Write it such as 30 %." if parameter.scale == "log" else "Write it with its unit."
        yield Fault("unit", message, hint, project.place(*key, "scatter"), format_path(key))
    start = np.array([constant.start for constant in law.constants], dtype=np.float64)
    for section in project.sections:
        value, _ = law.at(section.covariates, start)
        if parameter.lower <= value <= parameter.upper:
            continue
        unit = shown_unit("", parameter.dimension)
        message = f"at the starts of its constants the law gives {value:.4g} {unit}".rstrip()
        message += f" for the section '{section.name}', outside the bounds of '{law.parameter}' "
        message += f"({parameter.lower:.4g} to {parameter.upper:.4g})"
        hint = "Laws are computed in SI units: look at the units of constants and their starts."
        yield Fault("law-outside", message, hint, project.place(*key, "formula"), format_path(key))
        return
