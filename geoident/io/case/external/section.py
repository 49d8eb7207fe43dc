"""What a case says of a model that geoident does not compute itself."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, WithJsonSchema

from geoident.io.case.external.by_gauge import ByGauge, LikeReading
from geoident.io.case.external.settlement_section import SettlementLawSection
from geoident.io.case.in_service.seasonal import SeasonalModelSection
from geoident.io.case.readings import Date
from geoident.io.schema.duration import GivenTime
from geoident.io.schema.section import Alternatives, Section, SectionFaults, optional
from geoident.io.schema.values import (
    Coefficient,
    Count,
    FixedLength,
    Multiple,
    Name,
    Size,
    Text,
    TextOrMapping,
    Time,
    require_text,
)
from geoident.io.text.wording import Refusal, shorten


def _whole(value: object) -> int:
    text = str(value) if isinstance(value, int) else require_text(value, "a whole number")
    if not re.fullmatch(r"-?[1-9][0-9]{0,8}", text.strip()):
        message = f"'{shorten(text)}' is not a whole number other than 0"
        raise Refusal("bad-count", message, "Count from 1; -1 is the last one.")
    return int(text)


def _called(value: object) -> str:
    text = require_text(value, "MODULE:FUNCTION").strip()
    if not re.fullmatch(r"[^:]*[^:\s]:[A-Za-z_]\w*", text):
        message = f"'{shorten(text)}' is not a function"
        hint = "Write 'mymodel:readings' for the function readings in mymodel.py beside the case."
        raise Refusal("bad-function", message, hint)
    return text


def _pattern(value: object) -> str:
    text = require_text(value, "a regular expression")
    try:
        re.compile(text)
    except re.error as error:
        message = f"'{shorten(text)}' is not a regular expression: {error}"
        raise Refusal(
            "bad-pattern", message, "Put a \\ before ( ) [ ] . * + ? that are meant."
        ) from None
    return text


Called = Annotated[str, BeforeValidator(_called)]
Pattern = Annotated[str, BeforeValidator(_pattern)]
CountedPlace = Annotated[
    int, BeforeValidator(_whole), WithJsonSchema({"type": "integer", "not": {"const": 0}})
]


def _row_shape(value: object) -> str:
    return "mapping" if isinstance(value, Mapping) else "number"


TableRow = Annotated[
    Annotated[CountedPlace, Tag("number")]
    | Annotated[dict[Name, Text], Field(min_length=1), Tag("mapping")],
    Discriminator(_row_shape),
]


def _line_shape(value: object) -> str:
    text = str(value).strip()
    return "number" if re.fullmatch(r"-?[0-9]+", text) else "text"


TextLine = Annotated[
    Annotated[CountedPlace, Tag("number")] | Annotated[Pattern, Tag("text")],
    Discriminator(_line_shape),
]


class OutputSection(Section):
    """How readings are found in what a run of the program leaves.

    In `file`, `column`, `row`, `pointer`, `dataset`, `line`, `find` and `observation`, `{gauge}`,
    `{stage}` and `{number}` (of the stage, from 1) stand for those of the reading that is looked
    for.
    """

    one_of = (
        Alternatives(
            "file column row?",
            "file pointer",
            "file dataset index?",
            "file line after? word",
            "file line after? columns",
            "file find occurrence?",
            "file instructions observation?",
            "function",
            hint="Give the keys of one of these ways.",
        ),
    )

    gauges: list[Name] | None = optional(
        "Gauges whose readings are found like this; all if missing."
    )
    stages: list[Name] | None = optional("Stages at which they are; all if missing.")
    unit: Text | None = optional(
        "In which the program writes them. Required but for readings without unit.", examples=["mm"]
    )
    file: Text | None = optional("File in the folder of the run.", examples=["out.csv"])
    column: Text | None = optional(
        "CSV: name of the column, in the first row.", examples=["u_wall"]
    )
    row: TableRow | None = optional(
        "CSV: number of the row below the names (-1: the last, which is the default), "
        "or the values of other columns in it.",
        examples=[1, {"stage": "{stage}"}],
    )
    pointer: Text | None = optional(
        "JSON: pointer to the number (RFC 6901).", examples=["/{stage}/{gauge}"]
    )
    dataset: Text | None = optional("HDF5: path of the dataset.")
    index: list[Annotated[int, Count(least=0)]] | None = optional(
        "HDF5: index of the number, from 0."
    )
    line: TextLine | None = optional(
        "Text: number of the line (-1: the last), or a regular expression that first "
        "matches in it.",
        examples=["DISPLACEMENTS"],
    )
    after: Annotated[int, Count(least=0)] | None = optional("Text: number of lines below `line`.")
    word: Annotated[int, Count()] | None = optional("Text: number of the word in the line.")
    columns: Annotated[list[Annotated[int, Count()]], Field(min_length=2, max_length=2)] | None = (
        optional("Text: first and last column of the number in the line.")
    )
    find: Pattern | None = optional(
        "Text: a regular expression whose one group is the number.", examples=["u = *([-+.0-9eE]+)"]
    )
    occurrence: CountedPlace | None = optional(
        "Text: which match of `find`, from 1; -1 for the last. Default 1."
    )
    instructions: Text | None = optional(
        "Text: an instruction file of PEST (`pif ~`) beside the case.", examples=["opening.ins"]
    )
    observation: Text | None = optional(
        "Name of the observation in `instructions`. Default `{gauge}`.",
        examples=["{gauge}_{number}"],
    )
    function: Called | None = optional(
        "`module:function` in a file beside the case, called with the folder of the "
        "run, gauge and stage."
    )

    def check(self, faults: SectionFaults) -> None:
        """The keys that find the number can find one."""
        if self.columns is not None and self.columns[0] > self.columns[1]:
            message = f"column {self.columns[0]} does not come before {self.columns[1]}"
            faults.add(("columns",), "bad-order", message, "Write the first one first.")
        if self.find is not None and re.compile(self.find).groups != 1:
            message = f"found {re.compile(self.find).groups} groups in the expression; expected one"
            faults.add(("find",), "bad-pattern", message, "Put the number, and only it, in ( ).")
        if self.pointer is not None and not self.pointer.startswith("/"):
            message = f"'{shorten(self.pointer)}' does not begin with /"
            faults.add(("pointer",), "bad-pointer", message, "Write it like /stages/0/u.")


_TIME_LIMIT = "Time after which a run is ended, and has failed; no limit if missing."
_AT_ONCE = "Number of runs at a time; one on each core if missing. 1 where there is one licence."


class TemplateSection(Section):
    """A template that says how its fields are written."""

    template: Text = Field(description="File beside the case.", examples=["cube.j2"])
    engine: Literal["fields", "jinja"] = Field(
        "fields",
        description="fields: `{{NAME [GPa]:10.3e}}` as in a template that is named alone; jinja: a "
        'template of Jinja, `{{ NAME | to("GPa") }}` with loops and conditions (extra jinja).',
    )


AnyTemplateSection = TextOrMapping[Text, TemplateSection]


class ExternalModelSection(Section):
    """A program that is run with files of its own, each run in a folder of its own."""

    kind: Literal["external"]
    command: Annotated[list[Text], Field(min_length=1)] = Field(
        description="The program and its arguments; there is no shell. A path with / is seen from "
        "the folder of the case.",
        examples=[["ccx", "-i", "cube"]],
    )
    inputs: dict[Text, AnyTemplateSection] = Field(
        min_length=1,
        description="Name of a file in the folder of the run to its template beside the case: a "
        "text with fields such as `{{E_rock:10.3e}}` or `{{E_rock [GPa]:10.3f}}`.",
        examples=[{"cube.inp": "cube.inp.template"}],
    )
    files: list[Text] = Field(
        [],
        description="Files beside the case that are copied into the folder of every run.",
        examples=[["mesh.inp"]],
    )
    outputs: list[OutputSection] = Field(
        min_length=1, description="How the readings are found in what a run leaves."
    )
    time_limit: GivenTime | None = optional(_TIME_LIMIT, examples=["10 min"])
    at_once: Annotated[int, Count()] | None = optional(_AT_ONCE)
    keep: Literal["failed", "all"] = Field(
        "failed", description="Of which runs the folders are kept."
    )


class PythonModelSection(Section):
    """A function of Python: from the parameters by name, SI, to the readings, SI."""

    kind: Literal["python"]
    function: Called = Field(
        description="`module:function` in a file beside the case. It is called with a mapping of "
        "names to values and gives a mapping of gauges to readings (a number, or stages to "
        "numbers), or an array (gauges, stages).",
        examples=["mymodel:readings"],
    )
    jacobian: Called | None = optional(
        "A function of the same file that gives the derivatives, an array (gauges, "
        "stages, parameters); without it differences are taken."
    )
    files: list[Text] = Field(
        [],
        description="Files that the function reads. With what it imports from beside it they are "
        "part of the model: runs of another state of them do not count. It cannot read others "
        "from beside the case.",
        examples=[["profile.csv"]],
    )
    time_limit: GivenTime | None = optional(_TIME_LIMIT, examples=["10 min"])
    at_once: Annotated[int, Count()] | None = optional(_AT_ONCE)


class TableModelSection(Section):
    """Runs that were made elsewhere: a table, between whose rows a response surface answers.

    The first line names the columns: parameters (`E_rock [GPa]`) and readings (`roof [mm]`, of
    several stages `roof @ heading [mm]`); each further line is a run. Or the simulations of a
    campaign of `geoident batch`.
    """

    kind: Literal["table"]
    file: Text = Field(
        description="CSV file beside the case, or the folder of a campaign of simulations.",
        examples=["runs.csv", "campaign.batch"],
    )
    surface: Literal["auto", "gaussian-process", "polynomial"] = Field(
        "auto",
        description="Between the runs: a Gaussian process, a polynomial, or for each reading the "
        "one with the smaller leave-one-out error.",
    )
    ignore: list[Text] = Field(
        [],
        description="Columns that are neither parameter nor reading; `run` needs no mention. Of a "
        "campaign: what varies and is passed over.",
    )


class TunnelSectionSection(Section):
    """A section of the tunnel whose convergence is measured."""

    chainage: FixedLength = Field(description="Where it is along the tunnel.", examples=["1250 m"])
    excavated: Date | None = optional(
        "When the face passed it; if missing, between two stages by `face` and `dates`."
    )
    gauges: list[Name] | None = optional(
        "Its gauges; all of them if missing, where there is one section."
    )


class ConvergenceLawSection(Section):
    """Convergence of a tunnel in distance to the face and time (Sulem, Panet and Guenot 1987).

    C = C_inf [1 - (X / (x + X))^2] {1 + m [1 - (T / (t + T))^n]}. Each constant is a number or
    `$NAME`, for all gauges or by gauge (`{H: $C_H, V: $C_V}`). Without `m`, `T` and `n` there is no
    growth in time.
    """

    one_of = (
        Alternatives("m T n", "", hint="Give all three, or none where nothing grows in time."),
    )

    kind: Literal["convergence-law"]
    face: dict[Name, FixedLength] = Field(
        min_length=1,
        description="Stage to the chainage of the face at its end; `stages` may be left out then.",
        examples=[{"day 1": "1252 m", "day 2": "1255.5 m"}],
    )
    sections: dict[Name, TunnelSectionSection] = Field(
        min_length=1, description="Sections of the tunnel by name.",
        examples=[{"A": {"chainage": "1250 m", "excavated": "2024-03-01"}}],
    )  # fmt: skip
    C_inf: ByGauge[LikeReading] = Field(
        description="Convergence far from the face before time adds to it, since the ground was "
        "undisturbed.",
        examples=["$C_inf"],
    )
    X: ByGauge[Size] = Field(description="Length of the influence of the face.", examples=["$X"])
    m: ByGauge[Coefficient] | None = optional(
        "Part of `C_inf` that time adds in the end.", examples=["$m"]
    )
    T: ByGauge[Time] | None = optional("Time of the growth.", examples=["$T"])
    n: ByGauge[Multiple] | None = optional(
        "Exponent of the growth in time, often 0.3.", examples=["0.3"]
    )


ElsewhereSection = Annotated[
    ExternalModelSection
    | PythonModelSection
    | TableModelSection
    | ConvergenceLawSection
    | SettlementLawSection
    | SeasonalModelSection,
    Field(discriminator="kind"),
]
