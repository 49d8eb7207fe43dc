"""Whether the names in a case refer to something, and fit what they refer to.

Names of stages, groups, materials, parameters and structures; what stands alone is judged by its
section, the sequence of stages in `stages`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace

from geoident.io.case.actions import LoadSection, WaterSection
from geoident.io.case.case import CaseSection, circle_of, numbers_with_paths, tied_parameters
from geoident.io.case.external.section import ConvergenceLawSection
from geoident.io.case.external.settlement_section import SettlementLawSection
from geoident.io.case.face import groups_released
from geoident.io.case.face_checks import check_face
from geoident.io.case.fit import AxisSection
from geoident.io.case.in_situ import GeostaticModel, HeimModel
from geoident.io.case.ladder import names_of_sets
from geoident.io.case.stages import ABSENT, Begin, check_sequence, refuse_group
from geoident.io.case.structures import BoltSection, PileSection
from geoident.io.case.yielding.sections import HardeningSoilSection
from geoident.io.schema.values import CaseNumber
from geoident.io.text.faults import Faults
from geoident.model.case import VIRGIN, KeyPath, format_path
from geoident.model.moments import stage_and_time
from geoident.units import with_article


def check_references(section: CaseSection, faults: Faults, wrong: Collection[str] = ()) -> None:
    """Note every name in the case that refers to nothing, and every impossible sequence.

    Args:
        section: the case.
        faults: where to note.
        wrong: sections that are left out of it; what refers to them waits until they are valid.
    """
    ground = section.model is None
    for check, needs, of_ground in _CHECKS:
        if needs.isdisjoint(wrong) and (ground or not of_ground):
            check(section, faults)
    if not wrong:
        _check_use(section, faults)


def _check_materials(section: CaseSection, faults: Faults) -> None:
    known = section.materials
    if ABSENT in known:
        message = f"'{ABSENT}' means an absent group; no material can have this name"
        faults.add(("materials", ABSENT), "reserved-name", message, "Rename it.", key=True)
    uses: list[tuple[KeyPath, str]] = [
        (("groups", group), name) for group, name in section.groups.items() if name != ABSENT
    ]
    for n, stage in enumerate(section.stages):
        for key, mapping in (("install", stage.install), ("change", stage.change)):
            uses += [(("stages", n, key, group), name) for group, name in mapping.items()]
    for path, name in uses:
        if name not in known:
            choices = (*known, ABSENT) if path[0] == "groups" else known
            faults.add_unknown(path, "material", name, choices)


def _check_groups(section: CaseSection, faults: Faults) -> None:
    """Groups with water in their pores or an in-situ stress of their own."""
    known = set(section.groups)
    known.update(group for stage in section.stages for group in stage.install)
    waters: list[tuple[KeyPath, WaterSection | None]] = [(("water",), section.water)]
    waters += [(("stages", n, "water"), stage.water) for n, stage in enumerate(section.stages)]
    named: list[tuple[KeyPath, str, bool]] = [
        ((*path, "groups", n), group, False)
        for path, water in waters
        for n, group in enumerate((water and water.groups) or ())
    ]
    if section.in_situ is not None:
        zones = section.in_situ.groups
        named += [(("in_situ", "groups", group), group, True) for group in zones]
    for place, group, key in named:
        if group not in known and (key or group not in section.interfaces):
            refuse_group(place, group, known, faults, key=key)


def _check_geostatic(section: CaseSection, faults: Faults) -> None:
    """What an in-situ stress that follows from the weight of the ground needs to know of it."""
    if section.in_situ is None:
        return
    zones = section.in_situ.groups
    present = [group for group, material in section.groups.items() if material != ABSENT]
    rest = [group for group in present if group not in zones]
    models: list[tuple[KeyPath, object, list[str]]] = [(("in_situ",), section.in_situ, rest)]
    models += [(("in_situ", "groups", name), zone, [name]) for name, zone in zones.items()]
    weighed = False
    for path, model, groups in models:
        if isinstance(model, GeostaticModel):
            weighed = True
            K0 = model.K0 or {}
            known = [group for group in groups if _is_hardening(section, group)]
            for key, given in (("K0", K0), ("K0_across", model.K0_across)):
                optional = known if key == "K0" else []
                _check_ratios((*path, key), given, groups, optional, section, faults)
    if not weighed:
        return
    if section.gravity is None:
        message = "the geostatic stress is the weight of the ground, and there is no gravity"
        faults.add(("in_situ",), "no-gravity", message, "Add 'gravity: 9.81 m/s2'.")
    for name in dict.fromkeys(section.groups[group] for group in present):
        if name in section.materials and section.materials[name].density is None:
            message = f"'{name}' has no density, of which the geostatic stress is made"
            hint = "Add 'density: 1900 kg/m3'; below a water table that of the saturated ground."
            faults.add(("materials", name), "no-density", message, hint, key=True)


def _loads(section: CaseSection) -> Iterator[tuple[KeyPath, LoadSection]]:
    """The loads of the case and of its stages, each with its path."""
    for name, load in section.loads.items():
        if isinstance(load, LoadSection):
            yield ("loads", name), load
    for n, stage in enumerate(section.stages):
        for name, load in stage.loads.items():
            yield ("stages", n, "loads", name), load


def _check_seismic(section: CaseSection, faults: Faults) -> None:
    """A seismic load is a part of the weight."""
    for path, load in _loads(section):
        if load.seismic is not None and section.gravity is None:
            message = "a seismic load is a part of the weight, and there is no gravity"
            hint = "Add 'gravity: 9.81 m/s2'."
            faults.add((*path, "seismic"), "no-gravity", message, hint, key=True)


def _check_compression(section: CaseSection, faults: Faults) -> None:
    """Heim's vertical stress is a pressure: one that is tension, whatever is sought, has no ground.

    A case with a tension that is meant gives its stress by components, which are positive there.
    """
    if section.in_situ is None:
        return
    models: list[tuple[KeyPath, object]] = [(("in_situ",), section.in_situ)]
    models += [(("in_situ", "groups", name), zone) for name, zone in section.in_situ.groups.items()]
    for path, model in models:
        if not isinstance(model, HeimModel):
            continue
        for key in ("vertical", "unit_weight"):
            given: CaseNumber | None = getattr(model, key)
            if given is None or not _is_negative(given, section):
                continue
            tied = given.parameter is not None
            message = f"'{given.text}' {'can only be' if tied else 'makes'} a tension in the ground"
            hint = f"Write '{given.text.strip().removeprefix('-').strip()}'."
            if tied:
                hint = f"Turn the sign of the tie, or of the bounds of '{given.parameter}'."
            message += "; expected a vertical pressure, compression positive"
            faults.add((*path, key), "tension", message, hint)


def _is_negative(given: CaseNumber, section: CaseSection) -> bool:
    """Whether a number is below zero, whatever its parameter becomes."""
    if given.parameter is None:
        return given.factor < 0
    parameter = section.parameters.get(given.parameter)
    return parameter is not None and all(given.factor * b.factor < 0 for b in parameter.bounds)


def _is_hardening(section: CaseSection, group: str) -> bool:
    """Whether a group is hardening soil at the beginning, whose past tells its K0."""
    material = section.materials.get(section.groups[group])
    return material is not None and isinstance(material.yields, HardeningSoilSection)


def _check_ratios(
    path: KeyPath,
    given: object,
    groups: Collection[str],
    optional: Collection[str],
    section: CaseSection,
    faults: Faults,
) -> None:
    """Ratios of horizontal stresses by group: one for each group that needs one, no other."""
    if not isinstance(given, Mapping):
        return
    missing = [group for group in groups if group not in given and group not in optional]
    if missing:
        message = f"no {path[-1]} for {', '.join(map(repr, missing))}"
        hint = "Add it, or write one number for all groups."
        place = path if given else path[:-1]
        faults.add(place, "missing-group", message, hint, key=True)
    for group in given:
        if group not in section.groups:
            faults.add_unknown((*path, group), "group", group, section.groups, key=True)
        elif group not in groups:
            absent = section.groups[group] == ABSENT
            why = (
                "is not there in the initial state, so it has no in-situ stress"
                if absent
                else "takes its in-situ stress from another place"
            )
            faults.add((*path, group), "absent-group", f"'{group}' {why}", "Remove it.", key=True)


def _check_stage_names(section: CaseSection, faults: Faults) -> None:
    """Names of stages, and the stages that others name."""
    names: dict[str, int] = {}
    for n, stage in enumerate(section.stages):
        first = names.setdefault(stage.name, n)
        if first != n:
            message = f"two stages are named '{stage.name}', "
            message += f"the first is {format_path(('stages', first))}"
            faults.add(("stages", n, "name"), "duplicate-stage", message, "Rename one.")

    def is_state(name: str) -> bool:
        """Whether it is a stage, or a moment of one: whether there is that is judged elsewhere."""
        return name in names or stage_and_time(name, names) is not None

    for n, name in enumerate(section.fit.stages or ()):
        if not is_state(name):
            faults.add_unknown(("fit", "stages", n), "stage", name, names)
    zeros = {VIRGIN: 0, **names}
    for name, gauge in section.gauges.items():
        if gauge.zero_stage not in zeros and not is_state(gauge.zero_stage):
            faults.add_unknown(("gauges", name, "zero"), "stage", gauge.zero_stage, zeros)


def _check_structures(section: CaseSection, faults: Faults) -> None:
    """The structures on which gauges sit."""
    for name, gauge in section.gauges.items():
        structure = getattr(gauge, "structure", None)
        if structure is not None and structure not in section.structures:
            key = "on" if hasattr(gauge, "on") else "structure"
            place = ("gauges", name, key)
            faults.add_unknown(place, "structure", structure, section.structures)


def _check_heads(section: CaseSection, faults: Faults) -> None:
    """Pulls and pushes act on free heads of grouted bars."""
    for path, load in _loads(section):
        if (load.pull is None and load.push is None) or load.on is None:
            continue
        place, bars = (*path, "on"), section.structures.get(load.on)
        if bars is None:
            faults.add_unknown(place, "structure", load.on, section.structures)
        elif not (
            isinstance(bars, PileSection)
            or (isinstance(bars, BoltSection) and bars.k_grout is not None)
        ):
            message = f"'{load.on}' are no grouted bolts or piles, whose heads a load pulls"
            hint = "Bars that are held at their ends are stressed by 'prestress'."
            faults.add(place, "wrong-structure", message, hint)
        elif bars.head != "free":
            message = f"the heads of '{load.on}' are joined to the ground, which a load on "
            message += "them loads"
            hint = "Write 'head: free' in the structure, or load the ground there."
            faults.add(place, "wrong-structure", message, hint)
        elif load.direction is not None and getattr(bars, "k_lateral", None) is None:
            message = f"'{load.on}' bear no force across themselves"
            hint = "Give the piles 'k_lateral', or remove the direction: a push along them."
            faults.add((*path, "direction"), "wrong-structure", message, hint)


def _check_interfaces(section: CaseSection, faults: Faults) -> None:
    """The interfaces that gauges span."""
    for name, gauge in section.gauges.items():
        spanned = getattr(gauge, "interface", None)
        if spanned is not None and spanned not in section.interfaces:
            place = ("gauges", name, "interface")
            faults.add_unknown(place, "interface", spanned, section.interfaces)


def _check_grid(section: CaseSection, faults: Faults) -> None:
    """The axes of a scan."""
    grid: dict[str, AxisSection] = getattr(section.fit.options("scan"), "grid", {})
    path: KeyPath = ("fit", "scan", "grid")
    if len(grid) > 2:
        message = f"found {len(grid)} axes; a scan has one or two"
        faults.add(path, "too-many-axes", message, "Remove some.", key=True)
    for name, axis in grid.items():
        parameter = section.parameters.get(name)
        if parameter is None:
            faults.add_unknown((*path, name), "parameter", name, section.parameters, key=True)
            continue
        for key, given in (("from", axis.start), ("to", axis.stop)):
            _check_dimension((*path, name, key), given, parameter.start, faults)
        if axis.start.factor == axis.stop.factor:
            message = f"the axis begins and ends at '{axis.stop.text}'"
            faults.add((*path, name, "to"), "zero-length", message, "Let them differ.")


def _check_mesh(section: CaseSection, faults: Faults) -> None:
    """Only a circular opening that the case gives does without a mesh."""
    circle = section.fit.options("closed-form")
    given = [getattr(circle, name) is not None for name in ("centre", "radius")]
    if section.mesh is not None or all(given):
        return
    message = "there is no mesh, and fit.closed-form gives no opening to compute in its place"
    hint = "Write 'mesh: {file: ...}', or in 'fit' 'closed-form: {centre: [0, 0 m], radius: 3 m}'."
    faults.add((), "no-mesh", message, hint)


def _check_face(section: CaseSection, faults: Faults) -> None:
    """The tunnel face and the distances to it."""
    check_face(section, circle_of(section), faults)


def _check_sequence(section: CaseSection, faults: Faults) -> None:
    """The stages one after the other."""
    begin = Begin(
        section.groups,
        section.materials,
        section.loads,
        section.structures,
        section.supports,
        groups_released(section.face, section.stages),
    )
    check_sequence(begin, section.stages, faults)


def _check_added(section: CaseSection, faults: Faults) -> None:
    """Offsets and drifts of gauges that may read anything are ties to what they read."""
    for name, gauge in section.gauges.items():
        for key, like in gauge.like_readings(gauge.dimension).items():
            given = getattr(gauge, key)
            if isinstance(given, CaseNumber) and given.parameter and not given.dimension:
                tie = replace(given, dimension=str(like.dimension))
                if given.parameter in section.parameters:
                    _check_tie(section, ("gauges", name, key), tie, given.parameter, faults)


def _check_external_fit(section: CaseSection, faults: Faults) -> None:
    """A model elsewhere has no simpler ones."""
    if section.model is not None and section.fit.ladder:
        message = "the model is external ('model'), so geoident cannot make simpler ones of it"
        faults.add(("fit", "ladder"), "no-ground", message, "Remove it.", key=True)


def _check_dimension(path: KeyPath, given: CaseNumber, start: CaseNumber, faults: Faults) -> None:
    if given.dimension != start.dimension:
        message = f"'{given.text}' is {with_article(given.dimension)}; "
        message += f"expected {with_article(start.dimension)}, as for the start '{start.text}'"
        faults.add(path, "unit", message)


def _check_ties(section: CaseSection, faults: Faults) -> None:
    """Ties to parameters that there are not, or that have another dimension."""
    for path, given in numbers_with_paths(section):
        if given.parameter is not None:
            _check_tie(section, path, given, given.parameter, faults)


def _check_use(section: CaseSection, faults: Faults) -> None:
    """Parameters on which nothing depends."""
    if not isinstance(section.model, ConvergenceLawSection | SettlementLawSection | None):
        return
    used = names_of_sets(section.fit.ladder or ()) | tied_parameters(section)
    for name in section.parameters:
        if name not in used:
            message = f"the parameter '{name}' is declared, but nothing depends on it"
            hint = f"Write ${name} where it stands, or remove it."
            faults.add(("parameters", name), "unused-parameter", message, hint, key=True)


def _check_tie(
    section: CaseSection, path: KeyPath, given: CaseNumber, name: str, faults: Faults
) -> None:
    parameter = section.parameters.get(name)
    if parameter is None:
        faults.add_unknown(path, "parameter", name, section.parameters)
    elif given.dimension and parameter.start.dimension != given.dimension:
        message = f"'{given.text}' is {with_article(parameter.start.dimension)} "
        expected = given.called or with_article(given.dimension)
        message += f"(start: {parameter.start.text}); expected {expected}"
        hint = "Change the unit of its start, or use another parameter."
        faults.add(path, "unit", message, hint)


_Check = Callable[[CaseSection, Faults], None]
_CHECKS: tuple[tuple[_Check, set[str], bool], ...] = (
    (_check_ties, {"parameters"}, False),
    (_check_added, {"parameters"}, False),
    (_check_materials, {"materials"}, True),
    (_check_groups, {"groups", "stages"}, True),
    (_check_geostatic, {"groups", "materials", "gravity"}, True),
    (_check_seismic, {"gravity"}, True),
    (_check_compression, {"parameters"}, True),
    (_check_stage_names, {"stages"}, False),
    (_check_structures, {"structures"}, False),
    (_check_heads, {"structures", "stages", "loads"}, True),
    (_check_interfaces, {"interfaces"}, False),
    (_check_grid, {"parameters"}, False),
    (_check_external_fit, set(), False),
    (_check_mesh, {"mesh", "fit"}, True),
    (_check_face, {"analysis", "face", "stages", "parameters", "groups", "mesh", "fit"}, True),
    (_check_sequence, {"groups", "loads", "structures", "supports", "face", "stages"}, True),
)
"""Checks, the sections to which they refer, and whether they are of a case with ground only."""
