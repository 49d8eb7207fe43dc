"""What is said of several sections, word for word, of numbers given by hand."""

from __future__ import annotations

from dataclasses import replace
from math import log, nan
from types import SimpleNamespace

import pytest

from geoident.model.results.findings import Finding
from geoident.model.results.many.project import (
    UNKNOWN_SCATTER,
    ZERO,
    LawEstimate,
    ProjectResult,
    SectionEnd,
    SectionParameter,
    SectionReading,
)
from geoident.workflow.project.findings import findings


def law(state, *, upper=0.0, scale="log"):
    return LawEstimate("E", "a * x", scale, 0.0, 0.0, upper, state, "GPa", "pressure")


def section(name, *, predicted=False, misfit=1.0, above=0.5, outlying=nan):
    return SectionEnd(name, "case.yaml", predicted, 4, "converged", misfit, above, outlying)


def alone(name, parameter, value, law):
    row = dict.fromkeys(SectionParameter.__dataclass_fields__, nan)
    return SimpleNamespace(
        **{**row, "section": name, "parameter": parameter, "alone": value, "law": law}
    )


def readings(name, inside, outside):
    """Readings of 1 with bands about them and about 3."""
    bands = [(0.8, 1.2)] * inside + [(2.8, 3.2)] * outside
    return [
        SectionReading(name, f"g{n}", "s", 1.0, 0.1, False, 1.0, low, high, "mm", "length")
        for n, (low, high) in enumerate(bands)
    ]


def said(*, gaps=(), laws=(), sections=(), parameters=(), read=(), left_out=()):
    """The findings of a result that has these and nothing else."""
    whole = SimpleNamespace(
        laws=laws, sections=sections, parameters=parameters, readings=read,
        left_out_readings=left_out,
        fitted=[s for s in sections if not s.predicted],
        predicted=[s for s in sections if s.predicted],
    )  # fmt: skip
    whole.of = lambda name: ProjectResult.of(whole, name)
    return [one.sentence for one in findings(whole, gaps)]


@pytest.mark.parametrize(
    ("one", "size"),
    [
        (law(ZERO, upper=0.312), "31 %"),
        (law(ZERO, upper=log(3.0)), "a factor 3"),
        (law(ZERO, upper=2.5e8, scale="linear"), "0.25 GPa"),
    ],
)
def test_a_scatter_that_sections_do_not_show_has_its_upper_end(one, size):
    assert said(laws=[one]) == [
        f"The sections do not show that E scatters about its law; up to {size} is possible (95 %)."
    ]


def test_a_scatter_of_which_nothing_is_known_says_what_helps():
    assert said(
        gaps=[Finding("not-determined", "a", "First.")], laws=[law("known"), law(UNKNOWN_SCATTER)]
    ) == [
        "First.",
        "How far E scatters about its law is not determined: there are too few sections for it, or "
        "they see too little. More sections, fewer constants, or a given scatter help; what is "
        "predicted has wide bands.",
    ]


@pytest.mark.parametrize(
    ("chance", "one_in"), [(0.0024, "420"), (1.0 / 54_321, "54 000"), (9e-7, "more than a million")]
)
def test_a_section_of_other_ground_is_named_with_its_odds(chance, one_in):
    """One in a hundred, of any of them: of four that are judged, one in four hundred each."""
    sections = [section("A", outlying=chance), section("B", outlying=0.0026), section("C")]
    sections += [section(name, outlying=0.5) for name in "DE"]
    rows = [alone("A", "E", 3.0, 2.0), alone("A", "K0", nan, 1.0), alone("B", "E", 9.0, 1.0)]
    assert said(sections=sections, parameters=rows) == [
        "The section A does not fit what all others tell of it (of the same ground, one in "
        f"{one_in} would be as far off): its ground, its case or its readings differ. Of A, its "
        "own fit gives 1.5 times the E of the law."
    ]


@pytest.mark.parametrize(
    ("above", "misfit", "poor"),
    [(0.99e-3, 1.5, True), (1.01e-3, 9.0, False), (1e-9, 1.49, False)],
)
def test_a_section_whose_readings_are_not_met_is_named(above, misfit, poor):
    told = "The model of A does not fit its readings: the residuals are 1.5 times as large as their"
    expected = [f"{told} errors explain."] if poor else []
    assert said(sections=[section("A", above=above, misfit=misfit)]) == expected


@pytest.mark.parametrize(
    ("inside", "outside", "end"),
    [
        (8, 2, "8 (80 %) lie within their 95 % bands: the law, or the models, miss something that "
         "differs between sections."),
        (9, 1, "9 (90 %) lie within their 95 % bands."),
        (0, 9, "0 (0 %) lie within their 95 % bands."),  # too few to say more
    ],
)  # fmt: skip
def test_readings_in_their_bands_are_counted(inside, outside, end):
    rows = [*readings("A", inside, 1), *readings("B", 0, outside - 1)]
    rows += [replace(one, measured=nan) for one in readings("C", 2, 2)]  # they judge nothing
    count = 1 if outside == 1 else 2
    where = f"Of {inside + outside} readings of {count} sections that were"
    assert said(left_out=rows) == [f"{where} left out in turn, {end}"]
    sections = [section(name, predicted=name != "D") for name in "ABCD"]
    of_fitted = readings("D", 0, 3)
    assert said(sections=sections, read=[*rows, *of_fitted]) == [f"{where} predicted, {end}"]
