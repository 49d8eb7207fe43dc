"""What is proven of identified yield limits: the planes stage by stage, the kind of answer."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from geoident.model.results.result import ParameterTable
from geoident.model.yielding import OF_STRUCTURE, Certificate
from geoident.report.text.layout import TextTable, bullets, number
from geoident.units import in_unit, shown_unit

TITLE = "Yield planes (strain points that yield on them, stage by stage)"

_KINDS = {
    "strongly stationary": "the derivatives of the misfit are zero and the answer does not lie at a"
    " kink of the response: no small change improves it",
    "stationary on the active pieces": "the answer lies at a kink of the response; none of the"
    " changes that were tried on either side improves it",
    "not stationary": "a small change may improve the answer",
    "global": "proven: no answer within the bounds is better",
}
_PA_PER_MPA = 1e6


def certificate_text(certificate: Certificate | None) -> str:
    """Kind, gradient and bound in sentences, then one line for each plane."""
    if certificate is None:
        return ""
    return "\n".join([bullets(certificate_sentences(certificate)), plane_table(certificate).text])


def certificate_sentences(certificate: Certificate) -> list[str]:
    """What kind of answer it is."""
    kind = certificate.kind[:1].upper() + certificate.kind[1:]
    sentences = [
        f"{kind}: {_KINDS.get(certificate.kind, certificate.kind)} "
        f"(gradient {number(certificate.gradient, 2)})."
    ]
    if math.isfinite(certificate.bound) and math.isfinite(certificate.gap):
        sentences.append(
            f"Proven: no misfit is below {number(certificate.bound)} "
            f"(gap {100 * certificate.gap:.2g} %)."
        )
    return [*sentences, *certificate.remarks]


def plane_table(certificate: Certificate) -> TextTable:
    """One row for each plane; for those never reached what is known of their distance."""
    activity = certificate.activity
    rows = [
        [
            name,
            _distance(certificate, r),
            *map(str, activity.points[r].tolist()),
            str(int(activity.biactive[r].sum())),
            "" if _reached(certificate, r) else _from_below(name, float(activity.reached[r])),
        ]
        for r, name in enumerate(activity.planes)
    ]
    header = ("plane", "k (MPa)", *activity.stages, "at a kink", "")
    return TextTable(header, rows, right="l" + "r" * (len(header) - 2) + "l")


def _reached(certificate: Certificate, r: int) -> bool:
    activity = certificate.activity
    return bool(activity.points[r].any() or activity.biactive[r].any())


def _distance(certificate: Certificate, r: int) -> str:
    """The strength of a plane; of a structure it is a force, which the structure says itself."""
    activity = certificate.activity
    if activity.planes[r].startswith(OF_STRUCTURE) or not _reached(certificate, r):
        return "-"
    return number(float(activity.distances[r]) / _PA_PER_MPA)


def _from_below(name: str, reached: float) -> str:
    if not np.isfinite(reached):
        return "no strain point has this material"
    if reached <= 0.0 or name.startswith(OF_STRUCTURE):
        return "never reached"
    return f"never reached: k >= {number(reached / _PA_PER_MPA)} MPa"


def least_text(certificate: Certificate | None, parameters: ParameterTable, i: int) -> str:
    """What is known of a parameter whose planes are never reached, in its unit; else nothing.

    Args:
        certificate: the certificate, or None.
        parameters: with names, units and dimensions.
        i: which of them.
    """
    value = None if certificate is None else certificate.lower_bounds.get(parameters.names[i])
    if value is None:
        return ""
    unit = parameters.units[i], parameters.dimensions[i]
    return f"at least {number(in_unit(value, *unit))} {shown_unit(*unit)}".rstrip()


def certificate_object(certificate: Certificate) -> dict[str, Any]:
    """The certificate for other programs, SI."""
    activity = certificate.activity
    return {
        "kind": certificate.kind,
        "gradient": certificate.gradient,
        "bound": certificate.bound,
        "gap": certificate.gap,
        "remarks": certificate.remarks,
        "at_least": certificate.lower_bounds,
        "planes": [
            {
                "plane": name,
                "distance": activity.distances[r] if _reached(certificate, r) else None,
                "reached": activity.reached[r],
                "points": dict(zip(activity.stages, activity.points[r], strict=True)),
                "biactive": dict(zip(activity.stages, activity.biactive[r], strict=True)),
            }
            for r, name in enumerate(activity.planes)
        ],
    }
