"""A comparison of two results as text for a terminal and as an object for other programs."""

from __future__ import annotations

import math
from typing import Any

from geoident.model.results.comparison import Amount, Comparison, Difference
from geoident.report.text.layout import TextTable, number, section, sections, sentence
from geoident.units import in_unit, shown_unit, si_unit

_DIGITS = 7  # so that what differs by the usual tolerance is seen to differ


def comparison_text(comparison: Comparison) -> str:
    """What differs, table by table, in the units of the case and readings in mm."""
    first, second = comparison.statuses
    return sections(
        f"A: {comparison.first}\nB: {comparison.second}",
        _kinds(comparison),
        "" if first == second else f"Status: {first} in A, {second} in B",
        *(section(name.capitalize(), _table(comparison, name)) for name in _tables(comparison)),
        _total(comparison),
    )


def _kinds(comparison: Comparison) -> str:
    """What is compared where the results are of different commands."""
    first, second = comparison.kinds
    if first == second:
        return ""
    return sentence(
        f"A is a {first}, B a {second}: parameters and readings are compared, which both have; "
        "what only one kind of result has counts as a difference."
    )


def _tables(comparison: Comparison) -> list[str]:
    return list(dict.fromkeys(d.place.table for d in comparison.differences))


def _table(comparison: Comparison, name: str) -> str:
    rows = [_row(d) for d in comparison.differences if d.place.table == name]
    return TextTable(("", "", "A", "B", "B - A", "relative", "unit"), rows, right="llrrrrl").text


def _row(difference: Difference) -> list[str]:
    place, first, second = difference.place, difference.first, difference.second
    some = first or second
    unit = shown_unit(some.unit, some.dimension) if some else ""
    return [
        place.item,
        place.quantity,
        _shown(first, some),
        _shown(second, some),
        _gap(first, second),
        _relative(first, second),
        unit,
    ]


def _shown(amount: Amount | None, like: Amount | None) -> str:
    """A number in the unit of another one, so that both can be compared; a dash for none."""
    if amount is None or like is None:
        return "-"
    return number(in_unit(amount.value, like.unit, like.dimension), _DIGITS)


def _gap(first: Amount | None, second: Amount | None) -> str:
    if first is None or second is None:
        return "only in " + ("B" if first is None else "A")
    return number(in_unit(second.value - first.value, first.unit, first.dimension), 3)


def _relative(first: Amount | None, second: Amount | None) -> str:
    share = relative(first, second)
    return "" if share is None else f"{100 * share:.2g} %"


def relative(first: Amount | None, second: Amount | None) -> float | None:
    """The difference as a share of the larger of two numbers; None where that has no meaning."""
    if first is None or second is None:
        return None
    share = (second.value - first.value) / (max(abs(first.value), abs(second.value)) or 1.0)
    return share if math.isfinite(share) else None


def _total(comparison: Comparison) -> str:
    count, differing = comparison.compared, len(comparison.differences)
    if comparison.same:
        return f"The same: {count} numbers agree."
    return f"Different: {differing} of {count} numbers."


def comparison_object(comparison: Comparison) -> dict[str, Any]:
    """The same for other programs, SI units."""
    return {
        "first": comparison.first,
        "second": comparison.second,
        "same": comparison.same,
        "kinds": comparison.kinds,
        "statuses": comparison.statuses,
        "compared": comparison.compared,
        "differences": [_difference(d) for d in comparison.differences],
    }


def _difference(difference: Difference) -> dict[str, Any]:
    first, second, place = difference.first, difference.second, difference.place
    some = first or second
    return {
        "table": place.table,
        "item": place.item,
        "quantity": place.quantity,
        "first": first.value if first else None,
        "second": second.value if second else None,
        "relative": relative(first, second),
        "unit": si_unit(some.dimension) if some else "",
    }
