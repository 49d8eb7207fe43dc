"""Factors of safety, for people and for programs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from geoident.model.results.safety import FELT, SafetyBand, SafetyFactor


def safety_text(
    factors: Sequence[SafetyFactor], bands: Sequence[SafetyBand], *, poor: bool = False
) -> str:
    """What was found, in sentences, a paragraph a stage.

    Args:
        factors: of the stages.
        bands: of the same; none without a fit.
        poor: the model of the fit does not fit the readings.
    """
    parts = []
    for n, one in enumerate(factors):
        sentences = [*_factor_sentences(one), *(_band_sentences(bands[n]) if bands else ())]
        parts.append("\n".join(sentences))
    if poor:
        parts.append("The model of the fit does not fit its readings: do not rely on this.")
    return "\n\n".join(parts)


def _factor_sentences(one: SafetyFactor) -> Iterator[str]:
    if not one.bounded:
        yield (
            f"Stage '{one.stage}': factor of safety at least {one.lower:.3g}: the ground carries "
            "the loads with its strength divided by that."
        )
    else:
        fails = "the ground collapses" if one.proven else "no equilibrium was found"
        yield (
            f"Stage '{one.stage}': factor of safety {one.value:.3g} (equilibrium with strength "
            f"divided by {one.lower:.4g}, {fails} with {one.upper:.4g})."
        )
        if one.value < 1.0:
            yield "The strength that is there does not carry the loads of this stage."
    if one.place:
        yield f"As it fails, {one.place}."
    if one.bounded and not one.proven and not one.associated:
        yield (
            "That it collapses there is not proven, since its dilation is below its friction; with "
            "associated flow the factor is at least this."
        )
    if one.kept:
        yield f"These keep their strength: {', '.join(one.kept)}."
    if one.unyielding:
        yield f"These never yield: {', '.join(one.unyielding)}."


def _band_sentences(band: SafetyBand) -> Iterator[str]:
    known = np.isfinite(band.factors)
    yield (
        f"By the fit its 95 % interval is {band.lower95:.3g} to {band.upper95:.3g}, its "
        f"median {band.median:.3g}."
    )
    yield f"The probability that it is below one is {_probability(band)}."
    yield (
        f"It was computed at {known.sum()} draws of the posterior ({band.counted} below one); a "
        f"{band.surface} surface through them predicts others to {100.0 * band.left:.2g} %."
    )
    if lost := int((~known).sum()):
        yield f"At {lost} more draws the model has no answer: these are left out."
    if low := int((band.bounded[known] == 0).sum()):
        yield f"At {low} of them the ground carries the largest factor that was tried."
    size = np.abs(band.influence)
    named = [
        f"{band.names[i]} ({100.0 * band.influence[i]:+.2g} %)"
        for i in np.argsort(-size)
        if size[i] > FELT * size.max(initial=0.0) and size[i] > 0.0
    ]
    if named:
        yield f"One standard deviation of a parameter changes it by: {', '.join(named[:6])}."
    if band.left_open:
        names = ", ".join(f"'{name}'" for name in band.left_open)
        yield (
            f"The fit does not determine {names}: the band counts all values between the bounds as "
            "equally likely, and means no more than these bounds do."
        )


def _probability(band: SafetyBand) -> str:
    if band.below_one < 1e-3 and band.below_one_sd < 1e-3:
        return "below 0.1 %"
    spread = f", give or take {100.0 * band.below_one_sd:.1g} % by the choice of draws"
    return f"{100.0 * band.below_one:.2g} %{spread if band.below_one_sd > 0.0 else ''}"


def safety_object(
    factors: Sequence[SafetyFactor], bands: Sequence[SafetyBand], *, case: str,
    output: str | None, status: str, exit_code: int,
) -> dict[str, Any]:  # fmt: skip
    """The same for programs, SI.

    Args:
        factors: of the stages.
        bands: of the same; none without a fit.
        case: path of the case or fit.
        output: path of the fields that were written, or None.
        status: ``done``, ``poor-fit`` or ``not-determined``.
        exit_code: of the command.
    """
    stages = [
        {**_factor_object(one), **({"band": _band_object(bands[n])} if bands else {})}
        for n, one in enumerate(factors)
    ]
    return {
        "case": case,
        "kind": "safety",
        "status": status,
        "exit_code": exit_code,
        "output": output,
        "stages": stages,
    }


def _factor_object(one: SafetyFactor) -> dict[str, Any]:
    return {
        "stage": one.stage,
        "factor": one.value,
        "lower": one.lower,
        "upper": one.upper if one.bounded else None,
        "proven": one.proven,
        "associated": one.associated,
        "kept": list(one.kept),
        "unyielding": list(one.unyielding),
        "place": one.place,
        "path": [
            {"factor": factor, "moved": moved}
            for factor, moved in zip(one.factors.tolist(), one.moved.tolist(), strict=True)
        ],
    }


def _band_object(band: SafetyBand) -> dict[str, Any]:
    return {
        "lower95": band.lower95,
        "median": band.median,
        "upper95": band.upper95,
        "below_one": band.below_one,
        "below_one_sd": band.below_one_sd,
        "counted_below_one": band.counted,
        "surface": band.surface,
        "surface_error": band.left,
        "influence": dict(zip(band.names, band.influence.tolist(), strict=True)),
        "undetermined": list(band.undetermined),
        "draws": [
            {
                "factor": factor if np.isfinite(factor) else None,
                "bounded": bool(bounded),
                "parameters": dict(zip(band.names, values, strict=True)),
            }
            for factor, bounded, values in zip(
                band.factors.tolist(), band.bounded.tolist(), band.draws.tolist(), strict=True
            )
        ],
    }
