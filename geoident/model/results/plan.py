"""A plan of gauges: which of the candidates tell most of what is to be known."""

from __future__ import annotations

from dataclasses import dataclass

from geoident.model.results.columns import ROW, Record, column

_IN_UNIT = {"dimension": ROW, "unit": "SI unit"}


class PlanTarget(Record):
    """What is to be known, and how well it will be; SI, NaN where there is nothing.

    Args:
        text: as it was asked for.
        expected: the prediction, or the value of the parameter.
        sd: standard deviation as it is known now.
        sd_case: once the gauges of the case are read, up to the stage before.
        sd_plan: once the chosen gauges are read, too.
        least_ratio: the smallest of `sd_plan` by `sd_case` over the draws of the parameters.
        largest_ratio: the largest.
        probability: that the reading is beyond the limit, 0 to 1.
        settled_case: chance that the gauges of the case settle that: it is below 5 % or above 95 %
            then.
        settled_plan: chance that they and the chosen ones do.
        unit: in which people see it.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    text: str
    expected: float = column(like=_IN_UNIT)
    sd: float = column(like=_IN_UNIT)
    sd_case: float = column(like=_IN_UNIT)
    sd_plan: float = column(like=_IN_UNIT)
    least_ratio: float
    largest_ratio: float
    probability: float
    settled_case: float
    settled_plan: float
    unit: str = column(dimension=ROW, name="display_unit", title="unit")
    dimension: str = column(hidden=("csv", "json"))


@dataclass(frozen=True)
class PlannedGauge:
    """A candidate. Parts are of what the gauges of the case leave unknown: of variances.

    Args:
        gauge: its name.
        kind: of the gauge.
        cost: in the unit of the budget.
        rank: its place in the order of what they add, from 1; 0 for one that was not chosen.
        adds: part that falls once it is read beside those before it; of one that was not chosen,
            beside all that are.
        alone: part that falls if it is the only one.
        loss: part by which the standard deviation of what is to be known grows if it fails.
        stages: at which its readings tell, those that tell most first.
    """

    gauge: str
    kind: str
    cost: float
    rank: int
    adds: float
    alone: float
    loss: float
    stages: str


class GaugePlan(Record):
    """Which gauges to take.

    Args:
        targets: what is to be known.
        gauges: all candidates, the chosen ones first.
        budget: that costs must not exceed.
        draws: parameter vectors at which the model was linearised.
        model_error: size of the model error that is taken into account; 0 for none.
    """

    targets: tuple[PlanTarget, ...] = column("target", group="plan_targets")
    gauges: tuple[PlannedGauge, ...] = column("candidate", group="plan_gauges")
    budget: float
    draws: int
    model_error: float

    @property
    def chosen(self) -> tuple[PlannedGauge, ...]:
        """The gauges to take, the one that tells most first."""
        return tuple(one for one in self.gauges if one.rank)

    @property
    def cost(self) -> float:
        """Of these."""
        return float(sum(one.cost for one in self.chosen))
