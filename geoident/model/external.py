"""A model without ground of its own: a program, a function of Python, a table of runs, a law.

What a case says of it, with the texts of its templates; nothing here is run. Runs are numbered
computations at one parameter vector: a program has a folder for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Literal

import numpy as np

from geoident.errors import Location
from geoident.model.arrays import Bools, Floats
from geoident.model.in_service import SeasonalModel
from geoident.model.parameter import Scalar
from geoident.model.settlement import SettlementLaw


@dataclass(frozen=True)
class TemplateField:
    """A place in a template at which the value of a parameter is written.

    Args:
        parameter: its name.
        size: of the unit in which it is written, in SI.
        form: how, as in Python's format strings; empty for all digits.
        location: in the template.
    """

    parameter: str
    size: float = 1.0
    form: str = ""
    location: Location = field(default=Location(""), compare=False)

    def written(self, value: float) -> str:
        """A value, SI, as it stands in the file.

        >>> TemplateField("E", 1e9, "8.3f").written(15e9)
        '  15.000'
        """
        number = value / self.size
        return format(number, self.form) if self.form else repr(float(number))

    def last_digit(self, value: float) -> float:
        """The size, SI, of the last digit that the form has; 0 where it has all of them.

        Forms with g leave out zeros at the end, which are digits nonetheless.

        >>> TemplateField("E", 1e6, ".3f").last_digit(30e6)
        1000.0
        >>> round(TemplateField("E", 1e6, ".10g").last_digit(30e6), 9)
        0.01
        """
        if not self.form:
            return 0.0
        text = self.written(value).strip()
        exponent = int(Decimal(text).as_tuple().exponent)
        if self.form[-1] in "gG" and float(text) != 0.0:
            digits = int(self.form[:-1].partition(".")[2] or 6)
            exponent = Decimal(text).adjusted() - max(digits, 1) + 1
        return float(10.0**exponent * self.size)

    def read(self, text: str) -> float:
        """The value, SI, that a program reads from what was written."""
        return float(text.replace("_", "").replace(",", "").rstrip("%")) * self.size


@dataclass(frozen=True)
class Template:
    """A file that is written for every run.

    Args:
        source: path of the template.
        target: name of the file in the folder of the run.
        pieces: texts and fields in their order.
    """

    source: str
    target: str
    pieces: tuple[str | TemplateField, ...]

    @property
    def fields(self) -> tuple[TemplateField, ...]:
        """The fields in their order."""
        return tuple(piece for piece in self.pieces if isinstance(piece, TemplateField))


@dataclass(frozen=True)
class JinjaTemplate:
    """A file that is written for every run by Jinja.

    Args:
        source: path of the template.
        target: name of the file in the folder of the run.
        text: of the template.
        fields: one for each parameter that it names, with all digits.
    """

    source: str
    target: str
    text: str
    fields: tuple[TemplateField, ...]

    @property
    def pieces(self) -> tuple[str, ...]:
        """All of its text."""
        return (self.text,)


AnyTemplate = Template | JinjaTemplate


@dataclass(frozen=True)
class TableCell:
    """A cell of a table of comma-separated values, whose first row names the columns.

    Args:
        column: its name.
        row: number of the row below the names, from 1, or from the end where below 0; or columns
            and what stands there in the row that is meant.
    """

    column: str
    row: int | tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class JsonValue:
    """A number in a JSON file.

    Args:
        pointer: where, as in RFC 6901: ``/stages/0/u``.
    """

    pointer: str


@dataclass(frozen=True)
class Hdf5Value:
    """A number of a dataset in an HDF5 file.

    Args:
        dataset: its path in the file.
        index: of the number, from 0; empty for a dataset of one number.
    """

    dataset: str
    index: tuple[int, ...]


@dataclass(frozen=True)
class LineValue:
    """A number in a line of a text.

    Args:
        line: its number, from 1, or from the end where below 0; or a regular expression that
            matches in it.
        after: how many lines below that.
        word: number of the word, from 1; 0 where columns are given.
        columns: first and last column, from 1, both included.
    """

    line: int | str
    after: int
    word: int
    columns: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class PatternValue:
    """What the one group of a regular expression finds in a text.

    Args:
        pattern: the expression.
        occurrence: which match, from 1, or from the end where below 0.
    """

    pattern: str
    occurrence: int


@dataclass(frozen=True)
class FunctionValue:
    """What a function of Python says, of the folder of the run, the gauge and the stage.

    Args:
        path: of the file that has it.
        name: of the function.
    """

    path: str
    name: str


@dataclass(frozen=True)
class Instruction:
    """One item of an instruction file of PEST.

    Args:
        kind: what it is: ``primary`` or ``marker`` (a text), ``advance`` (lines), ``blank`` (to the
            next word), ``tab`` (a column); ``free``, ``fixed``, ``semi``: an observation.
        text: of a marker; name of an observation. In small letters.
        first: number of lines; column, or first column, from 1.
        last: last column.
    """

    kind: Literal["primary", "marker", "advance", "blank", "tab", "free", "fixed", "semi"]
    text: str = ""
    first: int = 0
    last: int = 0


@dataclass(frozen=True)
class InstructionLine:
    """A line of an instruction file of PEST, with those that go on with it.

    Args:
        number: of the line, from 1.
        items: in their order.
    """

    number: int
    items: tuple[Instruction, ...]


@dataclass(frozen=True)
class InstructedValue:
    """What an instruction file of PEST finds.

    Args:
        path: of that file.
        observation: its name there, in small letters.
        lines: of the file.
    """

    path: str
    observation: str
    lines: tuple[InstructionLine, ...] = field(compare=False, repr=False)


Finding = (
    TableCell | JsonValue | Hdf5Value | LineValue | PatternValue | FunctionValue | InstructedValue
)


@dataclass(frozen=True)
class Output:
    """How one reading is found in what a run leaves.

    Args:
        channel: number of the channel.
        stage: number of the stage, from 0.
        file: name in the folder of the run; empty for a function.
        how: where the number stands.
        size: of its unit, in SI.
    """

    channel: int
    stage: int
    file: str
    how: Finding
    size: float


@dataclass(frozen=True)
class Machine:
    """How much a run may take.

    Args:
        time_limit: seconds after which it is ended and has failed; None for no limit.
        at_once: number of runs at a time; None for one on each core.
    """

    time_limit: float | None = None
    at_once: int | None = None


@dataclass(frozen=True)
class ExternalProgram:
    """A program that is run with files.

    Args:
        command: the program and its arguments.
        templates: what is written for each run.
        files: paths of what is copied into the folder of each run as it is.
        outputs: how readings are found.
        machine: what a run may take.
        keep_all: folders of runs that succeeded are kept as well.
        folder: of the case.
        code: paths of all files that are run, or decide what is.
    """

    command: tuple[str, ...]
    templates: tuple[AnyTemplate, ...]
    files: tuple[str, ...]
    outputs: tuple[Output, ...]
    machine: Machine
    keep_all: bool
    folder: str
    code: tuple[str, ...]

    @property
    def inputs(self) -> tuple[str, ...]:
        """Paths of all files that the model consists of."""
        sources = (template.source for template in self.templates)
        finds = (o.how.path for o in self.outputs if isinstance(o.how, InstructedValue))
        return tuple(dict.fromkeys((*sources, *self.files, *self.code, *finds)))

    @property
    def seen(self) -> frozenset[str]:
        """Names of the parameters that it is given."""
        return frozenset(f.parameter for template in self.templates for f in template.fields)


@dataclass(frozen=True)
class PythonFunction:
    """A function of Python.

    Args:
        path: of the file that has it.
        name: of the function.
        jacobian: name of the function in the same file that gives derivatives; empty for none.
        machine: what a run may take.
        files: paths of what it imports from beside it, and of what it reads.
    """

    path: str
    name: str
    jacobian: str
    machine: Machine
    files: tuple[str, ...] = ()

    @property
    def inputs(self) -> tuple[str, ...]:
        """Paths of all files that the model consists of."""
        return tuple(dict.fromkeys((self.path, *self.files)))


SurfaceKind = Literal["auto", "gaussian-process", "polynomial"]
"""Response surfaces between the runs of a table."""


@dataclass(frozen=True)
class RunTable:
    """Runs that were made elsewhere, between which response surfaces answer.

    Args:
        path: of the file that has them.
        surface: of which kind they are.
        names: of the n parameters of its columns.
        values: (r, n) parameters of the r runs, SI.
        readings: (r, n_stages, n_channels) what they gave, SI; NaN where there is no column.
        notes: what was left out of the file, or taken otherwise than it stands in the case.
        campaign: the file is that of a campaign, which stands for its folder.
    """

    path: str
    surface: SurfaceKind
    names: tuple[str, ...]
    values: Floats = field(compare=False)
    readings: Floats = field(compare=False)
    notes: tuple[str, ...] = ()
    campaign: bool = False

    @property
    def called(self) -> str:
        """The name of the file; of a campaign that of its folder."""
        path = Path(self.path)
        return path.resolve().parent.name if self.campaign else path.name

    def __len__(self) -> int:
        return len(self.values)

    @property
    def provided(self) -> Bools:
        """(n_stages, n_channels) which readings have a column."""
        return np.asarray(~np.isnan(self.readings[0]))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Paths of all files that the model consists of."""
        return (self.path,)


@dataclass(frozen=True)
class Creep:
    """What time adds to the convergence law: {1 + m [1 - (T / (t + T))^n]}, gauge by gauge.

    Args:
        size: n_channels of m, the part by which convergence grows in the end.
        time: n_channels of T, s.
        exponent: n_channels of n.
    """

    size: tuple[Scalar, ...]
    time: tuple[Scalar, ...]
    exponent: tuple[Scalar, ...]


@dataclass(frozen=True)
class ConvergenceLaw:
    """Convergence of a tunnel in distance to the face and time (Sulem, Panet and Guenot 1987).

    C(x, t) = C_inf [1 - (X / (x + X))^2] {1 + m [1 - (T / (t + T))^n]}

    Args:
        limit: n_channels of C_inf, in the unit of what the gauge reads.
        range: n_channels of X, m.
        creep: what time adds; None for nothing.
        distance: (n_stages, n_channels) from the section to the face, m; NaN before it passed.
        age: (n_stages, n_channels) since the section was excavated, s; NaN where it does not count.
    """

    limit: tuple[Scalar, ...]
    range: tuple[Scalar, ...]
    creep: Creep | None
    distance: Floats = field(compare=False)
    age: Floats = field(compare=False)

    @property
    def scalars(self) -> tuple[Scalar, ...]:
        """All its constants."""
        own = () if self.creep is None else self.creep.size + self.creep.time + self.creep.exponent
        return self.limit + self.range + own

    @property
    def seen(self) -> frozenset[str]:
        """Names of the parameters of which it is made."""
        return frozenset(s.parameter for s in self.scalars if s.parameter is not None)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Paths of all files that the model consists of: none."""
        return ()


ExternalSource = (
    ExternalProgram | PythonFunction | RunTable | ConvergenceLaw | SettlementLaw | SeasonalModel
)


def seen_parameters(source: ExternalSource, names: Sequence[str]) -> tuple[bool, ...]:
    """Which parameters a model elsewhere is given.

    Args:
        source: the model.
        names: of all parameters.
    """
    if isinstance(source, PythonFunction):
        return (True,) * len(names)
    if isinstance(source, RunTable):
        return tuple(name in source.names for name in names)
    if isinstance(source, SeasonalModel):
        return (False,) * len(names)
    return tuple(name in source.seen for name in names)
