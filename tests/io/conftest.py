"""A small sound case, and a way to spoil it and see exactly what is said."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis.configuration import set_hypothesis_home_dir

from geoident.errors import Fault, InputError
from geoident.io.case.file import read_case
from geoident.io.loaded import LoadedCase

set_hypothesis_home_dir(str(Path(tempfile.gettempdir()) / "geoident-hypothesis"))

MARK = "«"
"""Stands before the place at which a fault is expected."""

CASE = """\
format: geoident-case/1
title: Cavern
analysis: plane-strain
mesh: {file: cavern.msh}
parameters:
  E_rock: {start: 15 GPa, bounds: [2 GPa, 80 GPa], scale: log}
  K0: {start: 1.0, bounds: [0.3, 3.0]}
materials:
  rock: {E: $E_rock, nu: 0.25, density: 2650 kg/m3}
  shotcrete: {elastic: isotropic, K: 8 GPa, G: 6 GPa}
groups: {rock: rock, heading: rock, bench: rock, lining: absent}
supports: {left: x, right: x, bottom: [x, y]}
in_situ: {model: heim, vertical: 8 MPa, K0: $K0}
gravity: 9.81 m/s2
loads:
  water: {on: left, pressure: 1 MPa}
stages:
  - {name: heading, excavate: [heading]}
  - {name: bench 1, excavate: [bench], install: {lining: shotcrete}}
gauges:
  EX1: {kind: extensometer, head: [12.5, 3 m], anchors: {a5: [17.5, 3 m]}, accuracy: 0.1 mm}
  CV1: {kind: convergence, between: [[-1, 0 m], [1, 0 m]], accuracy: 0.2 mm, zero: heading}
readings: readings.csv
fit: {method: gauss-newton, stages: [bench 1]}
"""

READINGS = """\
gauge,stage,value,unit
EX1.a5,heading,1.25,mm
EX1.a5,bench 1,,
CV1,bench 1,-3,mm
"""


@dataclass(frozen=True)
class Project:
    """A folder with a case."""

    folder: Path

    @property
    def file(self) -> str:
        return str(self.folder / "case.yaml")

    @property
    def readings_file(self) -> str:
        return str(self.folder / "readings.csv")

    def read(self, text: str = CASE, *overrides: str) -> LoadedCase:
        Path(self.file).write_text(text, encoding="utf-8")
        return read_case(self.file, overrides=overrides)

    def faults(self, text: str, *overrides: str) -> list[Fault]:
        with pytest.raises(InputError) as caught:
            self.read(text, *overrides)
        return list(caught.value.faults)

    def only_fault(self, text: str, *overrides: str) -> Fault:
        """The one fault of a text, which must be at the mark."""
        plain = text.replace(MARK, "")
        (fault,) = self.faults(plain, *overrides)
        if MARK in text:
            before = text[: text.index(MARK)]
            place = (before.count("\n") + 1, len(before) - before.rfind("\n"))
            assert (fault.location.line, fault.location.column) == place, str(fault)
            assert fault.location.file == self.file
        return fault


@pytest.fixture
def project(tmp_path: Path) -> Project:
    (tmp_path / "cavern.msh").touch()
    (tmp_path / "readings.csv").write_text(READINGS, encoding="utf-8")
    return Project(tmp_path)


@pytest.fixture
def changed() -> Callable[[str, str], str]:
    """The sound case with one text replaced."""

    def change(old: str, new: str) -> str:
        assert CASE.count(old) == 1, old
        return CASE.replace(old, new)

    return change
