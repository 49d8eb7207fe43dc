"""Factors of safety, for people and for programs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from geoident.model.results.result import Result
from geoident.model.results.safety import StageSafety, depends_on
from geoident.report.text.layout import TextTable, sentence

NAME = "Factors of safety"


def safety_text(result: Result) -> str:
    """What was found, in sentences, a paragraph a stage."""
    parts = ["\n".join(stage_sentences(one, result.parameters.names)) for one in result.safety]
    if result.status == "poor-fit":
        parts.append("The model of the fit does not fit its readings: do not rely on this.")
    return "\n\n".join(parts)


def stage_sentences(one: StageSafety, names: Sequence[str]) -> list[str]:
    """What was found of a stage.

    Args:
        one: the stage.
        names: of the n parameters.
    """
    return [*_factor_sentences(one), *(_band_sentences(one, names) if one.of_fit else ())]


def parts(result: Result) -> tuple[str, ...]:
    """For a terminal: all stages in a table, then each in words."""
    names = result.parameters.names
    words = (sentence(" ".join(stage_sentences(one, names))) for one in result.safety)
    return safety_table(result.safety).text, *words


def safety_table(rows: Sequence[StageSafety]) -> TextTable:
    """A row for each stage."""
    header, cells = ["stage", "factor"], []
    if of_fit := any(one.of_fit for one in rows):
        header += ["95 % from", "to", "P(below 1)"]
    for one in rows:
        cells.append([one.stage, f"{one.value:.3g}" if one.fails else f"at least {one.value:.3g}"])
        if of_fit:
            cells[-1] += [f"{one.lower95:.3g}", f"{one.upper95:.3g}"]
            cells[-1].append(probability(one).partition(",")[0])
    return TextTable(header, cells, right="lrrrr"[: len(header)])


def _factor_sentences(one: StageSafety) -> Iterator[str]:
    if not one.fails:
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
    if one.fails and not one.proven and not one.associated:
        yield (
            "That it collapses there is not proven, since its dilation is below its friction; with "
            "associated flow the factor is at least this."
        )
    if one.fails and not one.proven and one.associated:
        yield (
            "Beyond that the ground flows by more than 10 %, as in meshes without room for it, or "
            "no search came to an end."
        )
    if one.kept:
        yield f"These keep their strength: {one.kept}."
    if one.unyielding:
        yield f"These never yield: {one.unyielding}."


def _band_sentences(band: StageSafety, names: Sequence[str]) -> Iterator[str]:
    known = np.isfinite(band.factors)
    yield (
        f"By the fit its 95 % interval is {band.lower95:.3g} to {band.upper95:.3g}, its "
        f"median {band.median:.3g}."
    )
    yield f"The probability that it is below one is {probability(band)}."
    yield (
        f"It was computed at {known.sum()} draws of the posterior ({band.counted} below one); a "
        f"{band.surface} surface through them predicts others to {100.0 * band.left:.2g} %."
    )
    if lost := int((~known).sum()):
        yield f"At {lost} more draws the model has no answer: these are left out."
    if low := int((band.bounded[known] == 0).sum()):
        yield f"At {low} of them the ground carries the largest factor that was tried."
    size = np.abs(band.influence)
    felt = depends_on(names, band.influence)
    named = [
        f"{names[i]} ({100.0 * band.influence[i]:+.2g} %)"
        for i in np.argsort(-size)
        if names[i] in felt
    ]
    if named:
        yield f"One standard deviation of a parameter changes it by: {', '.join(named[:6])}."
    if band.undetermined:
        quoted = ", ".join(f"'{name}'" for name in band.undetermined.split(", "))
        yield (
            f"The fit does not determine {quoted}: the band counts all values between the bounds "
            "as equally likely, and means no more than these bounds do."
        )


def probability(band: StageSafety) -> str:
    """That the factor is below one, and how sure that is."""
    if band.below_one < 1e-3 and band.below_one_sd < 1e-3:
        return "below 0.1 %"
    spread = f", give or take {100.0 * band.below_one_sd:.1g} % by the choice of draws"
    return f"{100.0 * band.below_one:.2g} %{spread if band.below_one_sd > 0.0 else ''}"


def safety_object(result: Result, *, case: str, path: str) -> dict[str, Any]:
    """The same for programs, SI.

    Args:
        result: with the factors.
        case: path of the case or fit.
        path: of the result.
    """
    return {
        "case": case,
        "kind": result.kind,
        "status": result.status,
        "exit_code": int(result.exit_code),
        "result": path,
        "stages": safety_list(result.safety, result.parameters.names),
    }


def safety_list(rows: Sequence[StageSafety], names: Sequence[str]) -> list[dict[str, Any]]:
    """An object for each stage, SI.

    Args:
        rows: of the stages.
        names: of the n parameters.
    """
    return [
        {**_factor_object(one), **({"band": _band_object(one, names)} if one.of_fit else {})}
        for one in rows
    ]


def _listed(text: str) -> list[str]:
    return text.split(", ") if text else []


def _factor_object(one: StageSafety) -> dict[str, Any]:
    trials = zip(one.tried.tolist(), one.moved.tolist(), strict=True)
    return {
        "stage": one.stage,
        "factor": one.value,
        "lower": one.lower,
        "upper": one.upper if one.fails else None,
        "proven": one.proven,
        "associated": one.associated,
        "kept": _listed(one.kept),
        "unyielding": _listed(one.unyielding),
        "place": one.place,
        "path": [{"factor": F, "moved": moved} for F, moved in trials if np.isfinite(F)],
    }


def _band_object(band: StageSafety, names: Sequence[str]) -> dict[str, Any]:
    return {
        "lower95": band.lower95,
        "median": band.median,
        "upper95": band.upper95,
        "below_one": band.below_one,
        "below_one_sd": band.below_one_sd,
        "counted_below_one": band.counted,
        "surface": band.surface,
        "surface_error": band.left,
        "influence": dict(zip(names, band.influence.tolist(), strict=True)),
        "undetermined": _listed(band.undetermined),
        "draws": [
            {
                "factor": factor if np.isfinite(factor) else None,
                "bounded": bool(bounded),
                "parameters": dict(zip(names, values, strict=True)),
            }
            for factor, bounded, values in zip(
                band.factors.tolist(), band.bounded.tolist(), band.draws.tolist(), strict=True
            )
        ],
    }
