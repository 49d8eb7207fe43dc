"""Makes readings.xlsx: the truth in other ground and on another mesh, plus noise.

The ground of the truth differs from that of the case in more than its numbers: the moduli of clay
and sand grow with depth, and the clay yields. Noise has all that the `accuracy` of the case says,
shared errors too. Needs gmsh and openpyxl. Run: python make_readings.py
"""

import sys
from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from openpyxl import Workbook
from openpyxl.styles import Font
from openpyxl.worksheet.worksheet import Worksheet

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from truth_readings import simulate_truth  # noqa: E402

from geoident.model.gauges import Reading  # noqa: E402
from geoident.workflow.simulate import with_noise  # noqa: E402

# moduli of the slices of make_mesh.py, in parts of the mean, and strengths of the clay, downwards
GROWTH = {"clay": (0.85, 0.95, 1.05, 1.2), "sand": (0.8, 0.9, 1.12)}
STRENGTHS = ("40 kPa", "44 kPa", "50 kPa", "60 kPa")
SEED = 1

# when it was read, and of which stage it is
DATES = {
    "2025-03-04": "wall",
    "2025-03-17": "dig 1",
    "2025-03-24": "strut 1",
    "2025-04-09": "dig 2",
    "2025-04-18": "strut 2",
    "2025-04-24": "strut 2",
    "2025-05-07": "dig 3",
    "2025-05-27": "dig 4",
}
REMARKS = {
    "2025-03-04": "zero reading",
    "2025-04-09": "P4 under a skip",
    "2025-04-24": "rain",
    "2025-05-27": "bottom slab tomorrow",
}
NOT_READ = {("2025-04-09", "L1.P4"), ("2025-04-24", "LC1"), ("2025-04-24", "LC2")}
NO_CASING = {"2025-03-24"}  # the inclinometer was not read on these days
HEIGHTS = {"P1": 12.4127, "P2": 12.3980, "P3": 12.4051, "P4": 12.3768, "P5": 12.3514}  # m, at first
ABSENT = "n/a"

Values = dict[tuple[str, str], float]


def grow(case: dict[str, Any]) -> None:
    """Cuts clay and sand into the slices of the finer mesh, each with a modulus of its own."""
    materials, groups, ratios = case["materials"], case["groups"], case["in_situ"]["K0"]
    for layer, parts in GROWTH.items():
        base, ratio = materials.pop(layer), ratios.pop(layer)
        del groups[layer]
        for n, part in enumerate(parts, 1):
            slice_ = f"{layer}-{n}"
            materials[slice_] = {**base, "E": f"{part} {base['E']}"}
            groups[slice_], ratios[slice_] = slice_, ratio
            if layer == "clay":
                strength = STRENGTHS[n - 1]
                materials[slice_]["yield"] = {"type": "tresca", "strength": strength}
                dug = f"dig-{n + 1}"
                groups |= {dug: slice_} if dug in groups else {}


def read() -> Values:
    """Date and channel to what was read, SI."""
    truth = simulate_truth(HERE, mesh=("--size", 0.7, "--triangles", "--slices"), change=grow)
    exact = {(reading.channel, reading.stage): reading.value for reading in truth.readings}
    readings = []
    for day, stage in DATES.items():
        time = (datetime.fromisoformat(day) - datetime(1970, 1, 1)).total_seconds()
        for channel in truth.case.channels:
            value = exact.get((channel.name, stage))
            if value is not None and (day, channel.name) not in NOT_READ:
                readings.append(Reading(channel.name, stage, value, time=time))
    days = [datetime.fromtimestamp(reading.time or 0.0).date().isoformat() for reading in readings]
    noisy = with_noise(truth.case, readings, seed=SEED)
    return {
        (day, reading.channel): reading.value or 0.0
        for day, reading in zip(days, noisy, strict=True)
    }


def write_table(
    sheet: Worksheet, title: str, header: Sequence[Sequence[str]], rows: Iterable[Sequence[object]]
) -> None:
    """A table as a monitoring company would hand it over: a title, an empty row, the table."""
    sheet.append([title])
    sheet["A1"].font = Font(bold=True)
    sheet.append([])
    for line in [*header, *rows]:
        sheet.append(list(line))
    for cells in sheet.iter_rows(min_row=3 + len(header), max_col=1):
        cells[0].number_format = "DD/MM/YYYY"
    sheet.column_dimensions["A"].width = 12


def main() -> None:
    values = read()
    book = Workbook()
    book.properties.creator = "Monitoring"
    days = {day: datetime.fromisoformat(day) for day in DATES}

    def motion(day: str, depth: str) -> float:
        return round(1e3 * values.get((day, depth), 0.0), 2)

    casing = list(dict.fromkeys(name for _, name in values if name.startswith("I1.")))
    sheet = book.active or book.create_sheet()
    sheet.title = "Inclinometer"
    rows = [
        [days[day], *(motion(day, name) for name in casing), REMARKS.get(day, "")]
        for day in DATES
        if day not in NO_CASING
    ]
    title = "Inclinometer I1: displacement towards the pit, cumulated from the bottom"
    header = [["Date", *casing, "Remarks"], ["", *("mm" for _ in casing), ""]]
    write_table(sheet, title, header, rows)

    def height(day: str, point: str) -> object:
        if (day, f"L1.{point}") in NOT_READ:
            return ABSENT
        return round(HEIGHTS[point] - values.get((day, f"L1.{point}"), 0.0), 4)

    rows = [
        [days[day], *(height(day, point) for point in HEIGHTS), REMARKS.get(day, "")]
        for day in DATES
    ]
    header = [["Date", *(f"{point} (m)" for point in HEIGHTS), "Remarks"]]
    write_table(book.create_sheet("Levelling"), "Levelling: heights", header, rows)

    def force(day: str, cell: str) -> object:
        return round(1e-3 * values[day, cell]) if (day, cell) in values else ABSENT

    rows = [
        [days[day], force(day, "LC1"), force(day, "LC2"), REMARKS.get(day, "")]
        for day in list(DATES)[2:]
    ]
    header = [["Date", "Level 1", "Level 2", "Remarks"], ["", "Strut 7", "Strut 7", ""]]
    write_table(book.create_sheet("Load cells"), "Load cells: force of one strut, kN", header, rows)
    book.save(HERE / "readings.xlsx")


if __name__ == "__main__":
    main()
