"""The keys of a campaign file."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from geoident.io.cluster.sections import ClusterSection
from geoident.io.schema.duration import GivenTime
from geoident.io.schema.run_file import Settings, ValuePath
from geoident.io.schema.section import Alternatives, Section, SectionFaults, optional
from geoident.io.schema.values import Count, Flag, Name, Text, require_text
from geoident.io.text.wording import Refusal, shorten
from geoident.units import NUMBER_PATTERN

_SOLVERS = Literal["auto", "pardiso", "cholmod", "splu", "iterative"]
_WITH_UNIT = re.compile(rf"({NUMBER_PATTERN})\s*(.*)", re.DOTALL)


def _sampled(value: object) -> tuple[float, str]:
    """A number and the unit that is written behind it."""
    text = require_text(value, "a number with its unit").strip()
    match = _WITH_UNIT.fullmatch(text)
    if match is None:
        hint = "Write a number with a decimal point and its unit, such as 15 GPa."
        raise Refusal("bad-number", f"'{shorten(text)}' is not a number with a unit", hint)
    return float(match[1]), match[2].strip()


Sampled = Annotated[
    tuple[float, str], BeforeValidator(_sampled, json_schema_input_type=str | float)
]


class SpanSection(Section):
    """How one value is sampled: between two ends, or about a middle."""

    from_: Sampled | None = optional("Lower end, with its unit.", alias="from")
    to: Sampled | None = optional("Upper end, in the same unit.")
    scale: Literal["linear", "log"] = Field(
        "linear", description="Between two ends: evenly in the value, or in its logarithm."
    )
    mean: Sampled | None = optional("Mean of a normal value, median of a lognormal one.")
    sd: Sampled | None = optional(
        "Its standard deviation, in the same unit; of a lognormal one that of the "
        "logarithm times the median."
    )
    kind: Literal["normal", "lognormal"] = Field("normal", description="Its distribution.")

    def check(self, faults: SectionFaults) -> None:
        """Two ends or a middle and a width, in one unit and in their order."""
        values = {"from": self.from_, "to": self.to, "mean": self.mean, "sd": self.sd}
        given = [name for name, value in values.items() if value is not None]
        if given not in (["from", "to"], ["mean", "sd"]):
            message = f"found {' and '.join(given) or 'nothing'}; "
            message += "from and to, or mean and sd expected"
            faults.add((), "wrong-pair", message, "Write {from: 5 GPa, to: 20 GPa}.")
            return
        kind, (first, unit), (second, other_unit) = self.ends
        if unit != other_unit:
            message = f"the units '{unit}' and '{other_unit}' differ"
            faults.add((given[1],), "unit", message, "Write both in one unit.")
        elif given[0] == "from" and first >= second:
            message = f"{first:g} is not below {second:g}"
            faults.add(("from",), "bad-span", message, "Exchange both ends.")
        elif given[0] == "mean" and second <= 0.0:
            faults.add(("sd",), "bad-span", "a standard deviation is above zero")
        if kind in ("log", "lognormal") and first <= 0.0:
            hint = "Take the linear scale, or a normal value."
            faults.add((given[0],), "bad-span", f"{first:g} has no logarithm", hint)

    @property
    def ends(self) -> tuple[str, tuple[float, str], tuple[float, str]]:
        """The kind of span, and its two numbers with their unit."""
        if self.from_ is not None and self.to is not None:
            return self.scale, self.from_, self.to
        assert self.mean is not None
        assert self.sd is not None
        return self.kind, self.mean, self.sd


class SampleSection(Section):
    """Runs that fill a space evenly."""

    method: Literal["latin-hypercube", "sobol"] = Field(
        "latin-hypercube",
        description="Latin hypercube, or Sobol points with a random shift (even for powers of 2).",
    )
    count: Annotated[int, Count()] = Field(description="Number of runs.", examples=[64])
    seed: Annotated[int, Count(0)] = Field(0, description="Seed of the points.")
    values: dict[ValuePath, SpanSection] = Field(
        min_length=1,
        description="Path of a value of the case to how it is sampled.",
        examples=[{"parameters.E_rock.start": {"from": "5 GPa", "to": "20 GPa", "scale": "log"}}],
    )


class VariationsSection(Section):
    """What varies from run to run."""

    one_of = (Alternatives("table", "rows", "product", "sample", hint="Write one of them."),)
    table: Text | None = optional(
        "Path of a CSV file: its first line names values of the case by their paths, "
        "each further line is a run. An empty cell leaves the value of the base case. The column "
        "'run' names the runs; without it they are numbered.",
        examples=["runs.csv"],
    )
    rows: list[Settings] | None = optional(
        "The same in place: one mapping of paths to values a run.",
        examples=[[{"parameters.E_rock.start": "5 GPa"}, {"in_situ.K0": 1.5}]],
    )
    product: dict[ValuePath, Annotated[list[Any], Field(min_length=1)]] | None = optional(
        "Path to its values: one run for each combination, the last path fastest.",
        examples=[{"in_situ.K0": [0.8, 1.0, 1.5], "materials.rock.nu": [0.2, 0.3]}],
    )
    sample: SampleSection | None = optional("Runs that fill a space.")


class CampaignSection(Section):
    """A campaign for geoident: one case in many variations, and what is computed of each."""

    format: Literal["geoident-campaign/1"] = Field(description="Type and version of this file.")
    title: Text = Field("", description="Free text.")
    command: Literal["fit", "simulate", "predict", "scan"] = Field(
        "fit", description="What is computed of each run, as by the command of this name."
    )
    case: Text = Field(
        description="Path of the base case; of `predict`, the case to predict.",
        examples=["case.yaml"],
    )
    result: Text | None = optional(
        "Of `predict`: path of the fit to predict from.", examples=["case.fit.h5"]
    )
    set: Settings = Field(
        {},
        description="Path to a value that replaces that of the base case in all runs.",
        examples=[{"fit.backtest": False}],
    )
    variations: VariationsSection = Field(description="What varies from run to run.")
    seed: Annotated[int, Count(0)] = Field(0, description="Seed of random numbers of each run.")
    solver: _SOLVERS = Field("auto", description="Sparse solver.")
    max_time: GivenTime | None = optional(
        "Time after which the search of a run ends with what it has.", examples=["10 min"]
    )
    time_limit: GivenTime | None = optional(
        "Time after which a run counts as hanging: its process is ended, and it is restarted.",
        examples=["1 h"],
    )
    retries: Annotated[int, Count(0)] = Field(
        2, description="Times that a run is restarted after its process was lost."
    )
    cluster: ClusterSection | None = optional(
        "Cluster that computes the runs; the command line may name another."
    )
    noise: Flag = Field(False, description="Of `simulate`: add noise of each gauge's accuracy.")
    draw: Flag = Field(False, description="Of `simulate`: draw what varies from place to place.")
    stages: list[Name] = Field(
        [], description="Of `predict`: stages to predict; by default those that were not fitted."
    )

    def check(self, faults: SectionFaults) -> None:
        """The keys suit the command."""
        if self.command == "predict" and self.result is None:
            faults.add((), "missing-key", "'result' is missing", "Name the fit to predict from.")
        owners = {"result": "predict", "stages": "predict", "noise": "simulate", "draw": "simulate"}
        owners |= {"max_time": self.command if self.command in ("fit", "scan") else "fit"}
        for name, owner in owners.items():
            if getattr(self, name) not in (None, False, []) and self.command != owner:
                message = f"'{name}' is of the command {owner}; this campaign is to {self.command}"
                faults.add((name,), "wrong-command", message, "Remove it, or correct 'command'.")
