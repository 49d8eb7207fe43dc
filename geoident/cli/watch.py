"""``geoident watch``: cases whose files grow are updated, or controlled where they are in service.

What is to be done for a case is done by a command of its own, in a process of its own, so that the
watch neither grows nor falls with it. What the watch knows is in files: the last good results, and
beside each case which alarms were passed on (``CASE.watch``). It may be killed at any moment; the
next one goes on from there.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from geoident.cli.options import Options
from geoident.errors import ExitCode, Fault, InputError, Location, OutputError, UsageError
from geoident.io.result.file import read_identity
from geoident.io.text.atomic import atomic_output
from geoident.io.text.head import said_format
from geoident.report.text.json import dumps
from geoident.workflow.executing.environment import path_without_here
from geoident.workflow.executing.stop import StopRequest
from geoident.workflow.running.outputs import target
from geoident.workflow.updating.files import FileState, state_of, why_unfinished

_CASES = "geoident-case/"
"""Begins the format of a case."""

_BEGIN = "import sys; sys.path[:] = {!r}; from geoident.cli.app import main; main()"
_LOOK = 0.2
"""Seconds after which a wish to stop is looked at again."""

_ALARM_TIME = 600.0
"""Seconds that the command of an alarm may take."""

_PASSING = ("being-written", "missing-file", "unreadable-file")
"""Faults that may be gone at the next look though no file has changed since."""

_TOLD = (
    "new-readings", "alarm", "change", "changed-readings", "decision",
    "unit", "opposite-sign", "zero", "exchanged",
)  # fmt: skip
"""Findings that are told at once: what has happened, what it asks for, and what to correct."""

Say = Callable[[str, str, bool], None]
"""Takes a case, a line on it for people, and whether it is an error."""


@dataclass(frozen=True)
class Answer:
    """What a command said of a case.

    Args:
        code: its exit code.
        object: its JSON; empty if there is none.
        errors: what it said to people.
    """

    code: int
    object: Mapping[str, Any]
    errors: str

    @property
    def faults(self) -> set[str]:
        """Codes of what is wrong with the input."""
        return {fault["code"] for fault in self.object.get("faults", ())}

    @property
    def nothing_new(self) -> bool:
        """There was nothing to do."""
        return bool(self.object.get("nothing_new")) or "no-new-readings" in self.faults

    @property
    def sentence(self) -> str:
        """What came out, in a line."""
        said = [str(self.object.get("update") or self.object.get("reason") or "")]
        said += [
            finding["sentence"]
            for finding in self.object.get("findings", ())
            if finding["kind"] in _TOLD
        ]
        said = said if any(said) else self.errors.strip().splitlines()[-1:]
        return " ".join(" ".join(said).split()) or f"ended with exit code {self.code}"

    @property
    def alarms(self) -> list[str]:
        """Names of what is alarming now: an update, gauges that have changed, values reached."""
        if self.object.get("kind") == "control":
            changes = [row for row in self.object.get("changes", ()) if row["lasts"]]
            rows = {(row["kind"], row["gauge"]) for row in changes}
            parameters = [row for row in self.object.get("parameter_changes", ()) if row["lasts"]]
            rows |= {("change", row["parameter"]) for row in parameters}
            values = self.object.get("alarms", ())
            rows |= {(row["level"], row["gauge"]) for row in values if row["reached"]}
            return sorted(" ".join(row) for row in rows)
        steps = (self.object.get("updates") or {}).get("steps", ())
        return [f"update of {steps[-1]['made']}"] if steps and steps[-1]["alarm"] else []


@dataclass
class Watch:
    """Looks at cases again and again.

    Args:
        path: of a case, or of a folder in which cases are looked for, its subfolders included.
        say: takes what has happened, for people.
        on_result: takes the JSON of a command that has found something.
        stop: the wish to stop.
        on_alarm: command that is run when a new alarm appears; None for none.
        trust: what the cases run may run.
    """

    path: str
    say: Say
    on_result: Callable[[Mapping[str, Any]], None]
    stop: StopRequest
    on_alarm: Sequence[str] | None = None
    trust: bool = False
    _done: dict[str, Mapping[str, FileState]] = field(default_factory=dict)
    _said: dict[str, str] = field(default_factory=dict)

    def look(self) -> int:
        """Look at all cases once; the gravest exit code of what was found.

        Raises:
            InputError: there is no case.
            Interrupted: a stop was asked for.
        """
        try:
            cases = cases_of(self.path)
        except InputError as error:  # such as a folder of a network that is away
            if not self._done and not self._said:
                raise
            self._tell(self.path, error.faults[0].message, error=True)
            return ExitCode.INVALID_INPUT
        for known in (self._done, self._said):
            for gone in known.keys() - set(cases):
                del known[gone]
        codes = [self._look_at(case) for case in cases]
        graver = (ExitCode.ALARM, ExitCode.OUTPUT, ExitCode.BUG)
        return next((int(code) for code in graver if code in codes), max(codes, default=0))

    def _look_at(self, case: str) -> int:
        self.stop.check()
        files = state_of(case)
        if self._done.get(case) == files:
            return ExitCode.DONE
        if why := why_unfinished(files, time.time()):
            self._tell(case, f"waits, the last result stays: {why}")
            return ExitCode.DONE
        answer = self._ask(case)
        failed = answer.code not in (ExitCode.DONE, ExitCode.ALARM, ExitCode.NOT_CONVERGED)
        if answer.nothing_new:
            self._said.pop(case, None)
        elif failed:
            self._tell(case, f"failed, the last result stays: {answer.sentence}", error=True)
        else:
            self._tell(case, answer.sentence)
            self.on_result(answer.object)
        told = failed or self._pass_on(case, answer)
        passing = answer.code == ExitCode.OUTPUT or not answer.faults.isdisjoint(_PASSING)
        if told and not passing and state_of(case) == files:
            self._done[case] = files
        return ExitCode.DONE if answer.nothing_new else answer.code

    def _tell(self, case: str, words: str, *, error: bool = False) -> None:
        """Say what was not said last of the case."""
        if self._said.get(case) != words:
            self.say(case, words, error)
        self._said[case] = words

    def _ask(self, case: str) -> Answer:
        """The command that a case needs now."""
        fit = target(case, "fit").path
        written = read_identity(fit) if fit.exists() else None
        in_service = written is not None and "seasonal" in written.contents.split()
        words = ["control", str(fit)] if in_service else ["update", case]
        if self.trust and not in_service:
            words.append("--trust")
        python = [sys.executable, "-P", "-c", _BEGIN.format(path_without_here())]
        code, out, errors = run_program([*python, *words, "--json", "-q"], self.stop)
        about: Mapping[str, Any] = {}
        with suppress(ValueError, IndexError):
            about = json.loads(out.splitlines()[-1])
        return Answer(code, about, errors)

    def _pass_on(self, case: str, answer: Answer) -> bool:
        """Run the command for alarms that are new; whether nothing is left to be passed on.

        An alarm is written down as passed on after the command has ended well: killed between, the
        next watch runs it once more.
        """
        if self.on_alarm is None or not answer.object.get("kind"):
            return True
        note = Path(case).with_suffix(".watch")
        before: list[str] = []
        with suppress(OSError, ValueError):
            before = json.loads(note.read_text(encoding="utf-8"))["alarms"]
        now = answer.alarms
        if now == before:
            return True
        try:
            if set(now) - set(before) and not self._run_alarm(case, answer):
                return False
            with atomic_output(note, overwrite=True, inputs=(case,)) as temporary:
                text = json.dumps({"format": "geoident-watch/1", "alarms": now})
                Path(temporary).write_text(text + "\n", encoding="utf-8")
        except OutputError as error:
            self._tell(case, f"{error}", error=True)
            return False
        return True

    def _run_alarm(self, case: str, answer: Answer) -> bool:
        assert self.on_alarm is not None
        failed = passed_on(self.on_alarm, answer.object, self.stop)
        if failed:
            self._tell(case, f"{failed}; it is tried again", error=True)
        return not failed


def cases_of(path: str) -> list[str]:
    """Paths of the cases that are watched: a case, or those of a folder and its subfolders.

    Raises:
        InputError: there is none.
    """
    place = Path(path)
    if not place.is_dir():
        return [path]
    files = (one for ending in ("*.yaml", "*.yml") for one in place.rglob(ending))
    cases = sorted(str(one) for one in files if said_format(one).startswith(_CASES))
    if not cases:
        message = "there is no case in this folder"
        hint = "Name a case, or a folder with files that begin with 'format: geoident-case/1'."
        raise InputError([Fault("no-case", message, hint, Location(path))])
    return cases


def alarm_command(text: str | None, options: Options) -> list[str] | None:
    """The words of the command of ``--on-alarm``; None for none.

    Raises:
        UsageError: it is not trusted, or no command line.
    """
    if text is None:
        return None
    if not options.trust:
        raise UsageError("--on-alarm runs a program: add --trust if it may.")
    try:
        words = shlex.split(text)
    except ValueError:
        words = []
    if not words:
        raise UsageError(f"--on-alarm {text!r} is no command line.")
    return words


def passed_on(command: Sequence[str], about: Mapping[str, Any], stop: StopRequest) -> str:
    """Run the command of an alarm, with the JSON object of a result on its stdin.

    Returns:
        Why it has failed; empty where it has not.

    Raises:
        Interrupted: a stop was asked for.
    """
    try:
        code, _, errors = run_program(command, stop, dumps(about), _ALARM_TIME)
    except OSError as error:
        return f"the command of --on-alarm cannot be run: {command[0]}: {error.strerror}"
    last = "".join(errors.strip().splitlines()[-1:])
    return f"the command of --on-alarm ended with exit code {code}: {last}" if code else ""


def run_program(
    command: Sequence[str], stop: StopRequest, given: str = "", most: float = 0.0
) -> tuple[int, str, str]:
    """Run a program to its end.

    Args:
        command: its words.
        stop: the wish to stop, which ends it first.
        given: on its stdin.
        most: seconds after which it is ended; 0 for never.

    Returns:
        Its exit code, and what it printed on stdout and stderr.

    Raises:
        Interrupted: a stop was asked for.
    """
    begun, text = time.monotonic(), given
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, encoding="utf-8", errors="replace",
    )  # fmt: skip
    while True:
        try:
            out, errors = process.communicate(text or None, timeout=_LOOK)
        except subprocess.TimeoutExpired:
            text = ""  # it has been given
            if stop.exit_code is not None:
                process.terminate()
            elif most and time.monotonic() - begun > most:
                process.kill()
        else:
            stop.check()
            return process.returncode, out, errors
