"""A case that another program is going to drive, and the files that are written for that."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from geoident.errors import Term, UsageError
from geoident.forward.observed import ObservedModel
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.io.bridges.names import reading_names
from geoident.io.text.text_file import STDIN, seen_from
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.methods import ModelErrorOptions, SquaredOptions
from geoident.workflow.export import ListedFiles, Writer
from geoident.workflow.running.jobs import Inputs, build_model, load_inputs, require_stages
from geoident.workflow.running.readings import error_structure, select_readings
from geoident.workflow.simulate import simulated_pairs


@dataclass(frozen=True)
class DrivenCase:
    """A case and the folder for the files of the program that drives it.

    Args:
        path: of the case.
        inputs: it.
        model: of it.
        folder: of the files.
        seen: path of the case, seen from there.
        force: files that stand there are replaced.
    """

    path: str
    inputs: Inputs
    model: ObservedModel
    folder: Path
    seen: str
    force: bool

    @cached_property
    def readings(self) -> ReadingTable:
        """All readings of the case."""
        return select_readings(self.model.case, self.model)

    @cached_property
    def names(self) -> dict[tuple[str, str], str]:
        """Channel and stage of all that is simulated, in its order, to its name elsewhere."""
        pairs = simulated_pairs(self.model)
        return dict(zip(pairs, reading_names(pairs), strict=True))

    @cached_property
    def used(self) -> dict[tuple[str, str], int]:
        """Channel and stage of the readings that the fit uses to the row of the first of them."""
        rows: dict[tuple[str, str], int] = {}
        for k in np.flatnonzero(self.readings.used).tolist():
            if self.readings.pairs[k] in self.names:
                rows.setdefault(self.readings.pairs[k], k)
        return rows

    @cached_property
    def errors(self) -> ErrorStructure:
        """Of the used readings, in their order."""
        case = self.model.case
        channels = {channel.name: channel for channel in case.channels}
        rows = [case.readings[k] for k in self.used.values()]
        return error_structure([(channels[reading.channel], reading) for reading in rows])

    def write(self, texts: Mapping[str, str], stem: str) -> tuple[str, ...]:
        """Write the files; their paths.

        Args:
            texts: name to what it holds.
            stem: what the name of their list begins with.

        Raises:
            OutputError: a file exists or cannot be written.
        """
        writers: dict[Path, Writer] = {
            self.folder / name: partial(_write, text) for name, text in texts.items()
        }
        identity = self.inputs.identity("export", (), seed=0)
        files = self.inputs.files
        return ListedFiles(self.folder, stem, self.path, files, identity, self.force).write(writers)


def driven_case(
    path: str, program: str, output: str | None, *, not_taken: str, force: bool
) -> DrivenCase:
    """Read a case that a program is going to drive.

    Args:
        path: of the case.
        program: its name; in small letters the ending of the folder.
        output: folder of the files; ``CASE.PROGRAM`` beside the case if None.
        not_taken: characters that the program does not take in a command.
        force: files that stand there are replaced.

    Raises:
        InputError: the case is wrong.
        UsageError: the case comes from stdin, or its path has such characters.
    """
    if path == STDIN:
        message = f"{program} runs the case again and again: save it as a file and name that"
        raise UsageError(message)
    inputs = load_inputs(path)
    require_stages(inputs.case)
    model = build_model(inputs)
    beside = Path(path).with_name(f"{Path(path).stem}.{program.lower()}")
    folder = beside if output is None else Path(output)
    if set(seen := seen_from(folder, path)) & set(not_taken):
        signs = "blanks or quotes" if "'" in not_taken else "blanks"
        message = f"'{seen}' has {signs}, which {program} does not take in a command\n"
        raise UsageError(f"{message}    rename the case or its folder, or choose {Term.OUTPUT}")
    return DrivenCase(path, inputs, model, folder, seen, force)


def untold(case: Case, program: str) -> Iterator[str]:
    """What a program of least squares is not told of the fit of a case.

    Args:
        case: the case.
        program: its name.
    """
    if not isinstance(case.fit.loss, SquaredOptions):
        robust = "the robust loss of the case is left out"
        yield f"{program} weighs residuals by their squares; {robust}"
    if case.fit.model_error != ModelErrorOptions():
        yield "the model error of the case is left out"


def _write(text: str, part: str) -> None:
    Path(part).write_text(text, encoding="utf-8", newline="")
