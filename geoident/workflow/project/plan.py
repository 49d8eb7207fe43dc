"""From a project file to its sections: what is read, what is wrong with them, what is known."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import Fault, InputError
from geoident.io.project.file import read_project
from geoident.io.result.file import PROJECT_FORMAT
from geoident.io.text.faults import OVERRIDES
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.yaml_reader import MAX_BYTES
from geoident.model.case import Case, KeyPath, format_path
from geoident.model.methods import SquaredOptions
from geoident.model.parameter import Parameter
from geoident.model.project.project import ParameterLaw, Project, ProjectSection
from geoident.units import DIMENSIONLESS, shown_unit, with_article
from geoident.workflow.running.jobs import (
    Inputs,
    Planned,
    Request,
    load_inputs,
    require_stages,
    sha256,
)
from geoident.workflow.running.outputs import existing, require_free, stamp, target
from geoident.workflow.running.run_table import in_order, read_each

COMMAND = "fit"
LEAVE_ONE_OUT = "leave-one-out"


@dataclass(frozen=True)
class ProjectRequest(Request):
    """A project, whose file takes the place of that of a case, and what to do with it.

    Args:
        leave_one_out: predict each section from the others, too.
        jobs: sections to compute at a time; None for the cores there are.
    """

    leave_one_out: bool = False
    jobs: int | None = None


@dataclass(frozen=True, kw_only=True)
class ProjectJob(Planned):
    """A project that is to be fitted.

    Args:
        request: what was asked for.
        project: what its file says.
        text: of the file.
        inputs: the case of each section.
    """

    request: ProjectRequest
    project: Project
    text: str
    inputs: tuple[Inputs, ...]

    @property
    def files(self) -> tuple[str, ...]:
        """Paths of all that is read, which no output may replace."""
        named = (path for one in self.inputs for path in one.files)
        return tuple(dict.fromkeys((self.project.path, *named)))


def plan_project(request: ProjectRequest) -> ProjectJob:
    """Read a project and the cases of its sections, and look at what stands where its result goes.

    Raises:
        InputError: with all faults of the project, or else of the cases of its sections and of what
            they have in common.
        OutputError: the result could not be written, or another one would be lost.
    """
    project, inputs = read_sections(request.case)
    identity = _identity(project, inputs, request)
    place = target(request.case, COMMAND, output=request.output)
    job = ProjectJob(
        request=request,
        command=COMMAND,
        place=place,
        identity=identity,
        existing=existing(place, identity, kind=COMMAND, case=request.case),
        project=project,
        text=decode(read_bytes(request.case, limit=MAX_BYTES, what="project"), request.case),
        inputs=inputs,
    )
    options = [LEAVE_ONE_OUT] if request.leave_one_out else []
    job = replace(job, stamp=stamp(place.path.parent, job.files, COMMAND, options, request.seed))
    if not job.up_to_date:
        require_free(job.existing, place, force=request.force, inputs=job.files)
    return job


def read_sections(path: str) -> tuple[Project, tuple[Inputs, ...]]:
    """A project and the cases of its sections.

    Args:
        path: of the project.

    Raises:
        InputError: with all faults of the project, or else of the cases of its sections and of what
            they have in common.
    """
    project = read_project(path)

    def read(section: ProjectSection) -> Inputs:
        inputs = load_inputs(section.case, overrides=section.overrides)
        require_stages(inputs.case)
        return inputs

    inputs, faults = read_each(project.sections, read)
    faults += _common_faults(project, inputs)
    if faults:
        raise InputError(in_order(faults))
    return project, tuple(one for _, one in inputs)


def _identity(project: Project, inputs: Sequence[Inputs], request: ProjectRequest) -> str:
    contents = {
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
    return sha256(json.dumps(contents, sort_keys=True).encode())


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
            "not-of-a-project",
            f"the section '{section.name}' has constants that vary from place to place",
            "A section of a project has parameters alone: give the material one value.",
        )
    if not isinstance(case.fit.loss, SquaredOptions):
        yield case.source.fault(
            ("fit", "loss"),
            "not-of-a-project",
            f"the section '{section.name}' has a robust loss",
            "Flag readings that are wrong as bad, or raise their accuracy.",
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
    for key, ours, theirs in (
        ("bounds", (own.lower, own.upper), (known.lower, known.upper)),
        ("scale", own.scale, known.scale),
        ("start", own.dimension, known.dimension),
        ("prior", own.prior, known.prior),
    ):
        if ours != theirs:
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
            message = f"'{name}' of the predicted section '{section.name}' has no law or prior"
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
