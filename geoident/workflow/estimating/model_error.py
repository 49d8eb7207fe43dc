"""The model error of a fit: how large it is, in words, and why there is none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from geoident.errors import InputError
from geoident.forward.observed import ObservedModel
from geoident.identify.assessment.findings import join
from geoident.identify.assessment.model_error import SIZES, SizeWeights
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel, ReadingTable
from geoident.model.methods import (
    ComplementarityOptions,
    MethodOptions,
    ScanOptions,
    SquaredOptions,
)
from geoident.model.results.findings import Finding
from geoident.model.results.model_error import USUAL, ModelErrorTable
from geoident.units import in_unit, shown_unit
from geoident.workflow.estimating.model_error_covariance import (
    MOST_ENTRIES,
    MOST_MODES,
    CorrelationTime,
    ReadingSteps,
    family,
    most_modes,
    reading_steps,
    shared_columns,
)
from geoident.workflow.running.cost import free_memory
from geoident.workflow.running.readings import ChannelReading, errors_of_used

ENOUGH = 5
"""Readings more than parameters that can tell how large the model error is."""

SCATTER_SAID = 1.1
"""Factor on stated accuracies from which on it is mentioned."""

SCATTER_SURE = 1.25
"""Factor that it exceeds for sure (97.5 %) from which on it is a finding."""

ZERO_SURE = 0.5
"""Error of the zeros, in accuracies, that it exceeds for sure from which on it is a finding."""

NAME = "model error"
"""Of its component of variance."""


def no_model_error(
    case: Case, readings: ReadingTable, methods: Sequence[MethodOptions]
) -> str | None:
    """Why a fit has no model error, a sentence; empty where the case says so, None if it has one.

    Args:
        case: with its parameters.
        readings: of which some are used.
        methods: by which it is fitted.
    """
    why = _not_asked(case, methods)
    if why is not None or case.fit.model_error.kind == "given":
        return why
    places = set(readings.used_pairs)
    unknown = sum(not parameter.field for parameter in case.parameters)
    if len(places) >= unknown + ENOUGH:
        return None
    return (
        f"{len(places)} readings are too few beside {unknown} parameters to say how well the model "
        f"describes the ground ({ENOUGH} more than parameters would do): intervals and bands are "
        "those of a model without error. 'model_error: 15 %' under 'fit' assumes one."
    )


def require_room(case: Case, readings: ReadingTable, methods: Sequence[MethodOptions]) -> None:
    """Refuse readings whose errors need more memory than there is, or that are too many for them.

    Args:
        case: with its parameters and gauges.
        readings: of which some are used.
        methods: by which it is fitted.

    Raises:
        InputError: says what is needed, and what to do.
    """
    count = int(np.count_nonzero(readings.used))
    if count <= MOST_MODES:
        return
    asked = no_model_error(case, readings, methods) is None
    modes = most_modes(count) if asked else 0
    structure = errors_of_used(case, readings.used)
    robust = not isinstance(case.fit.loss, SquaredOptions)
    together = structure.columns.shape[1] + modes if robust or structure.names else 0
    memory = 16.0 * 8.0 * count * modes + 6.0 * 8.0 * together**2 + _BESIDE * count
    seconds = 7.5e-9 * count * modes**2 + 2e-8 * float(together) ** 3
    free = free_memory()
    channels = len({channel for channel, _ in readings.used_pairs})
    if modes >= _FEWEST_MODES or not asked:
        if free is None or memory <= free:
            return
        what = f"about {memory / 1e9:.1f} GB of memory, of which {free / 1e9:.1f} GB are free,"
    else:
        what = f"more than {_MOST_READINGS} readings allow, about {memory / 1e9:.1f} GB of memory"
    hint = "Take a part of the points (every tenth, say), or means of neighbouring ones"
    if together:
        hint += ", or 'loss: squared' and given accuracies"
    if asked:
        hint += ", or write 'model_error: none' under 'fit'"
    raise InputError([
        case.source.fault(
            ("fit",),
            "too-many-readings",
            f"{count} readings of {channels} channels need {what} and "
            f"{max(1.0, seconds / 60.0):.0f} min for what their errors have in common",
            f"{hint}."
        )
    ])  # fmt: skip


_FEWEST_MODES = 100
"""Columns of a model error below which it would no longer be that of the ground."""

_MOST_READINGS = MOST_ENTRIES // _FEWEST_MODES

_BESIDE = 6000.0
"""Bytes of a reading beside its errors: what is said of it, in memory and in the file."""


def _not_asked(case: Case, methods: Sequence[MethodOptions]) -> str | None:
    """Why the model error is no question, a sentence; empty where the case says so, None if it is.

    Args:
        case: the case.
        methods: by which it is fitted.
    """
    last = methods[-1]
    if case.fit.model_error.kind == "none":
        return ""
    if isinstance(last, ScanOptions):
        return "A scan shows the misfit without model error."
    if isinstance(last, ComplementarityOptions) and last.formulation == "global":
        return (
            "The bound that the formulation global proves holds without model error, so none is "
            "estimated."
        )
    return None


@dataclass(frozen=True)
class FittedModelError:
    """The model error that goes with the parameters of a fit.

    Args:
        used: what it is made of at the readings used.
        size: eta.
        length: over which it is correlated, m; NaN where no gauge has a place.
        weighed: what the residuals say of the size; None where it is given.
        findings: what cannot be told from it.
        factor: by which the readings scatter more than their stated accuracies.
        zero: error of the zero of each channel, in accuracies of a reading as it scatters.
        sd: (g,) standard deviations of the readings used, SI; None while they are searched.
        time: over which it is correlated; None where the errors are those of steps.
        course: error of the course in time that all channels share, in parts of the motion.
    """

    used: ReadingSteps
    size: float
    length: float
    weighed: SizeWeights | None = None
    findings: tuple[Finding, ...] = ()
    factor: float = 1.0
    zero: float = 0.0
    sd: Floats | None = None
    time: CorrelationTime | None = None
    course: float = 0.0

    def of_readings(self, rows: Sequence[ChannelReading]) -> FittedModelError:
        """The same for the readings (g) and their channels with accuracies that were estimated."""
        channels = tuple(channel for channel, _ in rows)
        sd = np.array([channel.sd(reading) for channel, reading in rows], dtype=np.float64)
        return replace(self, used=replace(self.used, channels=channels), sd=sd)

    def of_nothing_used(self) -> FittedModelError:
        """As large, where nothing that was read tells of it."""
        used = self.used
        moments = None if used.moments is None else used.moments[:0]
        used = replace(
            used, channels=(), steps=used.steps[:0], floors=used.floors[:0], moments=moments
        )
        return replace(self, used=used, sd=None)

    def with_later(self, structure: ErrorStructure, *later: ReadingSteps) -> ErrorStructure:
        """The errors of the readings used, and of later ones below them, with the model error.

        Args:
            structure: without it.
            *later: what it is made of there.
        """
        ratio = self.course / self.size if self.course else 0.0
        columns = self.size * shared_columns([self.used, *later], self.length, course=ratio)
        return structure.with_component(sp.csr_array(columns), NAME)

    def table(self, used: Bools) -> ModelErrorTable:
        """For a result, with rows for all readings (k,) of which some are used."""
        shape = (len(used), len(self.used.states))
        steps, floors = np.zeros(shape), np.zeros(shape)
        steps[used], floors[used] = self.used.steps, self.used.floors
        moments = None
        if self.used.moments is not None:
            moments = np.full(len(used), np.nan)
            moments[used] = self.used.moments
        weighed = self.weighed
        return ModelErrorTable(
            kind="given" if weighed is None else "estimated",
            size=self.size,
            lower95=self.size if weighed is None else weighed.quantile(0.025),
            upper95=self.size if weighed is None else weighed.quantile(0.975),
            length=self.length,
            sizes=np.array([self.size]) if weighed is None else SIZES,
            weights=np.ones(1) if weighed is None else weighed.weights,
            states=self.used.states,
            steps=steps,
            floors=floors,
            sentence=self.sentence(),
            factor=self.factor,
            factor_lower95=self._factor_quantile(0.025),
            factor_upper95=self._factor_quantile(0.975),
            zero=self.zero,
            zero_lower95=self._zero_quantile(0.025),
            zero_upper95=self._zero_quantile(0.975),
            time=np.nan if self.time is None else self.time.size,
            time_unit="" if self.time is None else self.time.unit,
            moments=moments,
            course=self.course,
        )

    def _factor_quantile(self, part: float) -> float:
        return 1.0 if self.weighed is None else self.weighed.factor_quantile(part)

    def _zero_quantile(self, part: float) -> float:
        return 0.0 if self.weighed is None else self.weighed.zero_quantile(part)

    def sentence(self) -> str:
        """Its size in words, and the scatter of the readings."""
        parts = [self._size_in_words(), self._course_in_words(), self.scatter(), self.offset()]
        return " ".join(filter(None, parts))

    def _course_in_words(self) -> str:
        """How far the course in time may be off; empty where that is no question."""
        if not self.course:
            return ""
        return (
            f"How the motion goes on in time may be off by {percent(self.course)} of it in all "
            "gauges alike, as the readings and usual errors of such models leave it."
        )

    @property
    def large(self) -> bool:
        """The residuals show a model error that is larger than usual, for sure."""
        return self.weighed is not None and self.weighed.quantile(0.025) > USUAL

    @property
    def shown(self) -> bool:
        """The residuals show a model error, however small."""
        return self.weighed is not None and self.weighed.quantile(0.025) > _NONE

    @property
    def scatters(self) -> bool:
        """Whether the readings scatter more than their stated accuracies, for sure."""
        return self._factor_quantile(0.025) > SCATTER_SURE

    def scatter(self) -> str:
        """By how much the readings scatter more than stated; empty where that is not worth a word.

        The accuracies of which the other sentence speaks are then these.
        """
        low, high = (self._factor_quantile(part) for part in (0.025, 0.975))
        if self.factor < SCATTER_SAID:
            return ""
        between = f"(95 %: {low:.2g} to {high:.2g})"
        if self.scatters:
            return (
                f"The readings scatter {self.factor:.2g} times as much as their stated accuracies "
                f"{between}; intervals and bands are those of this scatter."
            )
        sentence = f"That is {self.factor:.2g} times what the accuracies state {between}"
        if self.large:
            return (
                f"{sentence}, which does not explain the residuals: the model does not describe "
                "the ground, or readings are wrong."
            )
        return f"{sentence}: gauge error and model error cannot be separated by the residuals."

    def offset(self) -> str:
        """How large the errors of the zeros are; empty where the readings do not show any."""
        low, high = (self._zero_quantile(part) for part in (0.025, 0.975))
        if low < ZERO_SURE:
            return ""
        return (
            f"All readings of a channel share an error of {self.zero:.2g} accuracies (95 %: "
            f"{low:.2g} to {high:.2g}), as that of its zero is; bands allow for it."
        )

    def _size_in_words(self) -> str:
        what = "motion" if all(family(c) == "motion" for c in self.used.channels) else "change"
        within = f"The model meets the readings within {_accuracies(self.used.channels, self.sd)}"
        if self.weighed is None:
            taken = f"{percent(self.size)} of the computed {what}"
            return f"The model is assumed accurate to {taken}, as the case says."
        low, high = (self.weighed.quantile(part) for part in (0.025, 0.975))
        if not self.shown and high <= USUAL:
            return (
                f"{within} and at most {percent(high)} of the computed {what} (95 %): the "
                "residuals hardly show a model error."
            )
        if not self.shown:
            return (
                f"{within} and between nothing and {percent(high)} of the computed {what} (95 %): "
                "the residuals do not tell how large the model error is."
            )
        return (
            f"{within} and {percent(self.size)} of the computed {what} "
            f"(95 %: {percent(low)} to {percent(high)})."
        )


_NONE = 0.01
"""Lower end of the interval of the size below which no model error shows."""


def percent(part: float) -> str:
    """A part in words.

    >>> percent(0.0123), percent(0.997), percent(2.0)
    ('1.2 %', '100 %', '200 %')
    """
    return f"{100.0 * part:.2g} %" if part < _WHOLE else f"{100.0 * part:.0f} %"


_WHOLE = 0.995
"""From here on two digits would be 1e+02."""


def _accuracies(channels: Sequence[Channel], sd: Floats | None) -> str:
    """The accuracies of readings: one number or a range for each unit.

    Args:
        channels: of the g readings.
        sd: (g,) their standard deviations, SI; None for those that the gauges state.
    """
    sizes: dict[tuple[str, str], list[float]] = {}
    each = [c.accuracy for c in channels] if sd is None else sd.tolist()
    for channel, size in zip(channels, each, strict=True):
        sizes.setdefault((channel.unit, channel.dimension), []).append(size)
    ranges = []
    for (unit, dimension), accuracies in sizes.items():
        low, high = (
            f"{in_unit(x, unit, dimension):.2g}" for x in (min(accuracies), max(accuracies))
        )
        spread = low if low == high else f"{low} to {high}"
        ranges.append(f"{spread} {shown_unit(unit, dimension)}".rstrip())
    return join(ranges)


def model_error_findings(
    model_error: FittedModelError | None, *, correlated: bool = False
) -> Iterator[Finding]:
    """A model error that is larger than usual, or not told from other errors.

    Args:
        model_error: of a fit; None for none.
        correlated: residuals of neighbours go together beyond it.
    """
    if model_error is None:
        return
    if model_error.large or model_error.scatters or model_error.offset():
        numbers = {"size": model_error.size}
        sentence = model_error.sentence()
        if correlated and model_error.scatters:
            sentence += " They go together, so this is no scatter of the gauges (see there)."
        yield Finding("model-error", "", sentence, numbers)
    yield from model_error.findings


def model_error_notes(
    model_error: FittedModelError | None,
    case: Case,
    readings: ReadingTable,
    methods: Sequence[MethodOptions],
) -> tuple[str, ...]:
    """Why there is no model error, where nobody said that there should be none.

    Args:
        model_error: the model error of a fit, None for none.
        case: of the fit.
        readings: of which some were used.
        methods: of the fit.
    """
    if model_error is not None:
        return ()
    why = no_model_error(case, readings, methods)
    return (why,) if why else ()


@dataclass(frozen=True)
class LaterModelError:
    """The model error of a fit in later readings, maybe of another case.

    Args:
        fitted: of the fit.
        case: of the later readings.
        model: of that case.
        increments: (n_states, n_channels) what each step changes in what its channels see, SI.
    """

    fitted: FittedModelError
    case: Case
    model: ObservedModel
    increments: Floats

    def added(self, structure: ErrorStructure, pairs: Sequence[tuple[str, str]]) -> ErrorStructure:
        """The errors of the readings used, and of later ones below them, with the model error.

        Args:
            structure: without it.
            pairs: channel and stage of each later reading.
        """
        length, time = self.fitted.length, self.fitted.time
        later = reading_steps(self.case, self.model, self.increments, pairs, length, time)
        return self.fitted.with_later(structure, later)


def of_result(
    table: ModelErrorTable, channels: Sequence[Channel], rows: Bools | Ints
) -> FittedModelError:
    """The model error that a result holds.

    Args:
        table: in the result.
        channels: of the g readings used.
        rows: (k,) which of the readings they are, or (g,) their numbers.
    """
    moments = None if table.moments is None else table.moments[rows]
    steps, floors = table.steps[rows], table.floors[rows]
    used = ReadingSteps(tuple(channels), table.states, steps, floors, moments)
    time = CorrelationTime(table.time, table.time_unit) if table.time_unit else None
    return FittedModelError(
        used, table.size, table.length, factor=table.factor, time=time, course=table.course
    )
