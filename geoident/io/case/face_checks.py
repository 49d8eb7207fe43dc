"""What of a tunnel face and of the distances to it cannot be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from geoident.io.case.case import CaseSection
from geoident.io.case.face import FaceSection, PanetSection, groups_released
from geoident.io.case.parameters import ParameterSection
from geoident.io.schema.values import CaseNumber
from geoident.io.text.faults import Faults
from geoident.model.case import Analysis, KeyPath

_AT: KeyPath = ("face",)


def check_face(case: CaseSection, circle: float | None, faults: Faults) -> None:
    """Note what of a face and its distances cannot be.

    Args:
        case: the case.
        circle: radius of an opening without mesh, m, or None.
        faults: where to note.
    """
    section = case.face
    distances = [n for n, stage in enumerate(case.stages) if stage.distance is not None]
    if section is None:
        for n in distances:
            message = "the case does not say how a distance to the face releases stress"
            hint = "Add 'face: {profile: vlachopoulos-diederichs, radius: 4 m}'."
            faults.add(("stages", n, "distance"), "no-face", message, hint, key=True)
        return
    if case.analysis != Analysis.PLANE_STRAIN.value:
        message = f"'analysis' is {case.analysis}, in which the face is a part of the model"
        hint = "Excavate the tunnel up to it, stage by stage; 'face' belongs to plane strain."
        faults.add(_AT, "wrong-analysis", message, hint, key=True)
    if not distances:
        message = "no stage says how far its section is behind the face"
        faults.add(_AT, "no-distance", message, "Add 'distance: 2.5 m' to stages.", key=True)
    if section.radius is None and circle is None:
        message = "the radius of the tunnel is missing"
        hint = "Add 'radius: 4 m', of a tunnel that is not round that of the circle of its area."
        faults.add(_AT, "missing-key", message, hint, key=True)
    if section.conversion == "mesh" and circle is not None:
        message = "the case has no mesh whose wall would tell"
        hint = "Leave 'conversion' out: the closed form has its own reaction curve."
        faults.add((*_AT, "conversion"), "no-mesh", message, hint)
    for n, group in enumerate(section.groups or ()):
        if group not in case.groups:
            faults.add_unknown((*_AT, "groups", n), "group", group, case.groups)
    _check_numbers(section, case.parameters, faults)
    _check_distances(section, case, distances, faults)


def _range(
    given: CaseNumber, parameters: Mapping[str, ParameterSection]
) -> tuple[float, float] | None:
    """The least and the largest value of a number; None where its parameter is not known."""
    if given.parameter is None:
        return given.factor, given.factor
    if given.parameter not in parameters:
        return None
    low, high = sorted(given.factor * x.factor for x in parameters[given.parameter].bounds)
    return low, high


def _check_numbers(
    section: FaceSection, parameters: Mapping[str, ParameterSection], faults: Faults
) -> None:
    """Numbers, or both bounds of their parameters, are in the ranges of the profile."""
    for key in ("radius", "plastic_radius", *section.constants):
        given: CaseNumber | None = getattr(section, key, None)
        ends = None if given is None else _range(given, parameters)
        if given is None or ends is None:
            continue
        good, words = ends[0] > 0.0, "positive"
        if key == "alpha":
            good, words = ends[0] >= 0.0 and ends[1] < 1.0, "0 or more, and less than 1"
        if good:
            continue
        if given.parameter is not None:
            message = f"the bounds of {given.parameter} are too wide for '{key}' of the face"
            place: KeyPath = ("parameters", given.parameter, "bounds")
            faults.add(place, "out-of-range", message, f"It must be {words}.")
        else:
            message = f"'{given.text}': {key} must be {words}"
            faults.add((*_AT, key), "out-of-range", message, "Correct the number.")
    plastic, radius = getattr(section, "plastic_radius", None), section.radius
    if plastic is None or radius is None or plastic.parameter or radius.parameter:
        return
    if plastic.factor < radius.factor:
        message = f"the plastic radius '{plastic.text}' is within the tunnel ('{radius.text}')"
        hint = "It counts from the centre; where nothing yields it is the tunnel's."
        faults.add((*_AT, "plastic_radius"), "out-of-range", message, hint)


def _check_distances(
    section: FaceSection, case: CaseSection, distances: Sequence[int], faults: Faults
) -> None:
    """Distances fit the profile, release what nothing else does, and do not fall."""
    groups = groups_released(section, case.stages)
    before = -math.inf, ""
    for n in distances:
        stage = case.stages[n]
        given = stage.distance
        assert given is not None
        path: KeyPath = ("stages", n, "distance")
        least, _ = _range(given, case.parameters) or (0.0, 0.0)
        by_panet = getattr(section.averaged_with, "panet", None) is not None
        if (by_panet or isinstance(section, PanetSection)) and least < 0.0:
            message = f"'{given.text}' is ahead of the face, where Panet's profile ends"
            hint = "Take 'profile: vlachopoulos-diederichs' or 'chern', which cover this range."
            faults.add(path, "out-of-range", message, hint)
        for group in sorted(stage.release.keys() & set(groups)):
            message = f"what '{group}' releases is given, and follows from the distance, too"
            place = ("stages", n, "release", group)
            faults.add(place, "contradiction", message, "Remove one of the two.", key=True)
        if given.parameter is not None or stage.independent:
            continue
        if stage.base is None and given.factor < before[0]:
            message = f"the face is {given.text} away, after {before[1]}"
            hint = "A face advances or stops: correct one of the distances."
            faults.add(path, "face-order", message, hint)
        before = given.factor, f"{given.text} at '{stage.name}'"
