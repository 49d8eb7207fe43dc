"""How the parameters of a case are identified.

The section `fit` is made from the table of methods and their option types.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

from pydantic import BeforeValidator, Field, WithJsonSchema, create_model

from geoident.io.case.durations import is_date
from geoident.io.case.gauges.accuracy import EstimatedKinds
from geoident.io.case.ladder import LadderEntry
from geoident.io.case.model_error import ModelErrorValue, model_error_options
from geoident.io.case.readings import read_case_date
from geoident.io.schema.section import Section, optional
from geoident.io.schema.values import (
    AnyQuantity,
    CaseNumber,
    Count,
    CountOr,
    Exactly,
    FixedLength,
    Name,
    ParameterName,
    QuantityType,
    SharesUnit,
    TextOrList,
    require_text,
)
from geoident.io.text.dates import read_date
from geoident.io.text.wording import Refusal, did_you_mean, listing, shorten
from geoident.model.case import FitSettings
from geoident.model.methods import (
    LOSS_OPTIONS,
    METHOD_OPTIONS,
    ClosedFormOptions,
    LossOptions,
    MethodOptions,
    ScanAxis,
)
from geoident.units import DIMENSIONLESS

DEFAULT_METHOD = "gauss-newton"
DEFAULT_FOR_STRENGTHS = "complementarity"
"""What identifies strengths of yield limits where the case names no method."""

PlanePoint = Annotated[
    list[FixedLength],
    SharesUnit(),
    Exactly(2),
    Field(description="Coordinates x and y.", examples=[["0 m", "3 m"]]),
]


def _known_method(value: object) -> str:
    text = require_text(value, "the name of a method")
    if text not in METHOD_OPTIONS:
        message = f"there is no method '{shorten(text)}'; the methods are {listing(METHOD_OPTIONS)}"
        hint = did_you_mean(text, METHOD_OPTIONS, what="Methods")
        raise Refusal(
            "unknown-method", message, hint if hint.startswith("Did") else "Use one of them."
        )
    return text


MethodName = Annotated[
    str, BeforeValidator(_known_method), WithJsonSchema({"enum": list(METHOD_OPTIONS)})
]


_USES: Mapping[str, bool | str] = {
    "true": True, "yes": True, "false": False, "no": False, "keep": "keep"
}  # fmt: skip


def _known_use(value: object) -> bool | str:
    use = _USES.get(str(value).lower())
    if use is None:
        message = f"found '{shorten(str(value))}'; expected true, false or keep"
        raise Refusal("wrong-kind", message, "Write one of them, without quotes.")
    return use


def _date_or_moment(value: object) -> str:
    text = require_text(value, "a date or a stage").strip()
    return read_case_date(text) if is_date(text) else text


DateOrMoment = Annotated[
    str,
    BeforeValidator(_date_or_moment),
    WithJsonSchema(
        {
            "type": "string",
            "description": "a date such as 2024-03-01 [14:30], a stage, or one with a time such as "
            "fill 2 + 60 d",
        }
    ),
]


ReducedUse = Annotated[
    bool | str, BeforeValidator(_known_use), WithJsonSchema({"enum": [True, False, "keep"]})
]


class AxisSection(Section):
    """One axis of a scan, in the dimension of its parameter."""

    start: AnyQuantity = Field(alias="from", description="First value.")
    stop: AnyQuantity = Field(alias="to", description="Last value.")
    points: Annotated[int, Count(least=2)] | None = optional("Number of values.")

    def scan_axis(self, points: int) -> ScanAxis:
        """The axis, with this number of values where it does not give its own."""
        return self.to_model(ScanAxis, points=self.points or points)


class FitBase(Section):
    """How the parameters are identified."""

    method: TextOrList[MethodName, Annotated[list[MethodName], Field(min_length=1)]] | None = (
        optional(
            f"A method, or several that follow each other; without it {DEFAULT_METHOD}, and "
            f"{DEFAULT_FOR_STRENGTHS} where strengths of yield limits are parameters and no "
            "stage lasts: its many trials are of minutes each where ground yields in time."
        )
    )
    stages: Annotated[list[Name], Field(min_length=1)] | None = optional(
        "Stages whose readings are used (all if missing); others are predicted."
    )
    predict_gauges: Annotated[list[Name], Field(min_length=1)] | None = optional(
        "Gauges, or channels such as X.a, whose readings are not used: they are "
        "predicted with bands, and the result says how many lie inside.",
        examples=[["D-E"]],
    )
    until: DateOrMoment | None = optional(
        "Readings after this date are not used; they are predicted and judged. A stage "
        "stands for its end, and `STAGE + TIME` for a moment of a stage that lasts.",
        examples=["2024-12-31", "fill 2 + 60 d"],
    )

    accuracies: EstimatedKinds | None = optional(
        "What is to be estimated from the residuals, with the parameters: `estimate` "
        "for the accuracies of all gauges, or kinds of gauges, as in {inclinometer: estimate}. "
        "What the gauges state then gives the ratios, and the factor of each kind is estimated."
    )
    model_error: ModelErrorValue | None = optional(
        "How far the ground may differ from the model: `estimate` from the residuals "
        "(the default where they are enough), `none`, a part of the computed motion, "
        "or {size: , length: , time: }. Intervals and bands of later stages follow.",
        examples=["estimate", "none", "15 %", {"size": "15 %", "length": "20 m"}],
    )
    backtest: bool = Field(
        True,
        description="Whether a fit also predicts its last stage from those before it, which costs "
        "a few evaluations, and reports the result. Of a case of `tests` it does if that is asked.",
    )
    mesh_error: bool = Field(
        True,
        description="Whether a fit halves the elements of the mesh once, at the end, to see how "
        "much of the readings' accuracy is lost to mesh error (where that costs less than the fit; "
        "otherwise it estimates it from second order in space or the jumps of the stress), reports "
        "it, and widens intervals and bands by it.",
    )
    reduced: ReducedUse = Field(
        True,
        description="Whether steps of a search, points of a grid and draws may go by a reduced "
        "model, made of a few evaluations, where it is estimated to be close enough: in elastic "
        "ground, and where it saves time. Answers do not depend on it, only how long they take. "
        "`keep`: the result keeps one, made around the answer, which `sample`, `predict`, `scan` "
        "and `simulate` ask without a new evaluation.",
        examples=["keep"],
    )
    ladder: Annotated[list[LadderEntry], Field(min_length=2)] | None = optional(
        "Models to be fitted one after the other, from the simplest on, and compared: "
        "symmetries of the elasticity of the material whose moduli are parameters, or names with "
        "changes to the case.",
        examples=[["isotropic", "transversely-isotropic", "orthotropic"]],
    )
    loss: Literal["squared", "huber", "student-t"] = Field(
        "squared",
        description="How much a large residual counts: huber and student-t are robust against "
        "wrong readings.",
    )

    def chain(self, *, strengths: bool) -> tuple[str, ...]:
        """Names of the methods in their order.

        Args:
            strengths: strengths of yield limits are parameters, of a case without time.
        """
        if self.method is None:
            return (DEFAULT_FOR_STRENGTHS if strengths else DEFAULT_METHOD,)
        return (self.method,) if isinstance(self.method, str) else tuple(self.method)

    def options(self, name: str) -> Section:
        """The section with the options of a method or a loss."""
        section = getattr(self, _field_name(name))
        assert isinstance(section, Section)
        return section

    def settings(self, *, strengths: bool) -> FitSettings:
        """The same for the model, in SI units.

        Args:
            strengths: strengths of yield limits are parameters, of a case without time.
        """
        opening = self._method("closed-form")
        assert isinstance(opening, ClosedFormOptions)
        loss = LOSS_OPTIONS[self.loss]
        return self.to_model(
            FitSettings,
            methods=tuple(self._method(name) for name in self.chain(strengths=strengths)),
            loss=self.options(self.loss).to_model(loss) if fields(loss) else loss(),
            closed_form=opening,
            model_error=model_error_options(self.model_error),
            reduced=self.reduced is not False,
            keep_reduced=self.reduced == "keep",
            ladder=(),
            predict_gauges=tuple(self.predict_gauges or ()),
            until=read_date(self.until) if self.until and is_date(self.until) else None,
        )

    def _method(self, name: str) -> MethodOptions:
        given = self.options(name)
        axes: Mapping[str, AxisSection] = getattr(given, "grid", {})
        points: int = getattr(given, "points", 0)
        grid = {parameter: axis.scan_axis(points) for parameter, axis in axes.items()}
        return given.to_model(METHOD_OPTIONS[name], **({"grid": grid} if name == "scan" else {}))


def _field_name(name: str) -> str:
    """Name of the attribute that holds the options of a method or a loss."""
    return name.replace("-", "_")


def _option_model(kind: type[MethodOptions | LossOptions]) -> type[Section]:
    """The section of the options of a method or a loss."""
    hints = get_type_hints(kind)
    definitions: dict[str, Any] = {}
    for option in fields(kind):
        annotation = _annotation(hints[option.name], option.metadata)
        default: Any = option.default
        if option.default_factory is not MISSING:
            default = option.default_factory()
        if isinstance(default, float):
            default = CaseNumber(f"{default:g}", default, None, DIMENSIONLESS)
        field = Field(default, description=option.metadata["description"])
        definitions[option.name] = (annotation, field)
    name = f"{kind.__name__}Section"
    return create_model(name, __base__=Section, __doc__=kind.__doc__, **definitions)


def _annotation(hint: Any, limits: Mapping[str, Any]) -> Any:
    """The type of a key of the case for that of an option."""
    number = QuantityType(
        limits.get("dimension", DIMENSIONLESS),
        above=limits.get("above", 0.0),
        below=limits.get("below"),
    )
    kinds: dict[Any, Any] = {
        float: Annotated[CaseNumber, number],
        float | None: Annotated[CaseNumber, number] | None,
        int: Annotated[int, Count(limits.get("least", 1))],
        int | Literal["automatic"]: Annotated[int | str, CountOr("automatic")],
        tuple[float, float] | None: PlanePoint | None,
        Mapping[str, ScanAxis]: dict[ParameterName, AxisSection],
    }
    return kinds.get(hint, hint)


def _fit_model() -> type[FitBase]:
    definitions: dict[str, Any] = {}
    optional = {name: kind for name, kind in LOSS_OPTIONS.items() if fields(kind)}
    for name, kind in {**METHOD_OPTIONS, **optional}.items():
        model = _option_model(kind)
        description = f"Options of {name}."
        field = Field(default_factory=model, alias=name, description=description)
        definitions[_field_name(name)] = (model, field)
    return create_model("FitSection", __base__=FitBase, __doc__=FitBase.__doc__, **definitions)


if TYPE_CHECKING:
    FitSection = FitBase
else:
    FitSection = _fit_model()
