"""Findings: what an engineer must know before using the numbers of a result."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from geoident.model.results.columns import Record, column

FindingKind = Literal[
    # of parameters
    "not-determined", "not-separated", "only-prior", "at-bound", "prior-conflict", "correlated",
    "nonlinear", "other-minimum", "not-settled", "unreached", "law-scatter",
    # of readings and their errors
    "misfit", "far-reading", "gross-reading", "opposite-sign", "influential-reading", "unit",
    "zero", "exchanged", "no-motion", "correlated-residuals", "accuracy", "degrees-of-freedom",
    "mesh-error", "step-error", "surface-error", "model-error", "model-error-doubt",
    # of predictions
    "bands", "extrapolation", "collapse", "other-case", "alarm", "decision", "change",
    "new-readings", "changed-readings",
    # of numbers of the case
    "implausible",
    # of structures
    "strength", "pull",
    # of the result itself
    "no-reduced-model", "outdated",
]  # fmt: skip
"""What a finding is about; docs/result_file.md says what each means."""


class Finding(Record):
    """What an engineer must know before using the numbers.

    Args:
        kind: what it is about.
        subject: names of the parameters, channels, materials, stages or sections that it speaks of,
            joined by ``, ``; empty where it speaks of all.
        sentence: the finding, for people.
        numbers: those of the sentence that a program may want, by name, SI.
    """

    kind: FindingKind
    subject: str
    sentence: str
    numbers: Mapping[str, float] = column(default_factory=dict, hash=False)


def sentences_of(findings: Iterable[Finding]) -> tuple[str, ...]:
    """The findings as people read them."""
    return tuple(finding.sentence for finding in findings)
