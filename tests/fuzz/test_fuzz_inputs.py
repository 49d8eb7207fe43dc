"""Sound cases and readings, spoiled at random: what is said is an error of ours, soon and cheaply.

The whole values of shipped cases are deleted, doubled, replaced, moved and nested, so that the text
stays YAML and the checks behind are reached; ``tests/io/case/test_case_fuzz.py`` spoils characters.
Examples are the same each time (`tests/conftest.py`), and told as they were found. The long run has
others:
pytest -m slow tests/fuzz (GEOIDENT_FUZZ_EXAMPLES sets the examples of each test).
"""

import contextlib
import copy
import functools
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import pytest
import yaml
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from geoident.errors import GeoidentError, InputError
from geoident.io.case.file import parse_case
from geoident.io.readings.file import parse_readings
from geoident.workflow.check import check
from tests.support.trench import CASE, READINGS, write_case

SECONDS = 5
MEMORY = 1_000_000  # kB
LONG = os.environ.get("GEOIDENT_FUZZ_EXAMPLES")
EXAMPLES = int(LONG or "9")
FUZZ = settings(
    max_examples=EXAMPLES,
    deadline=None,  # `within` measures, and stops
    database=None,
    phases=tuple(Phase) if LONG else (Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
ROOT = Path(__file__).parents[2]
SHIPPED = sorted(ROOT.glob("cases/*/case.yaml"))

numbers = (
    st.integers() | st.floats() | st.sampled_from(["1e9", "-0", "1e400", "0x10", "1_000", "\u0661"])
)
quantities = st.builds(
    "{} {}".format, numbers, st.sampled_from(["m", "mm", "GPa", "MPa", "deg", "kg/m3", "Mpas", "%"])
)
words = st.sampled_from(
    [
        *(
            "no",
            "on",
            "~",
            "",
            "$x",
            "$K0",
            "0.5 $E",
            "$",
            "virgin",
            "absent",
            "rock",
            "x",
            "[",
            "<<",
        ),
        *("ground", "..", "/dev/zero", "\x00", "\u202e", "\U0001f600", "é", "!!python/object:os.x"),
    ]
)
scalars = numbers | quantities | words | st.text(max_size=12) | st.booleans() | st.none()
small = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
    max_leaves=6,
)


class TooSlow(Exception):
    """A limit of time was passed."""


WAITING = 30.0
"""Seconds on the clock for each one of the processor, until a wait counts as one without end."""


@contextlib.contextmanager
def within(seconds):
    """Stop what computes longer, however busy the machine is, or waits without end."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def stop(number, frame):
        raise TooSlow

    timers = [
        (signal.SIGPROF, signal.ITIMER_PROF, seconds),
        (signal.SIGALRM, signal.ITIMER_REAL, WAITING * seconds),
    ]
    before = [signal.signal(number, stop) for number, _, _ in timers]
    for _, timer, limit in timers:
        signal.setitimer(timer, limit)
    try:
        yield
    finally:
        for (number, timer, _), handler in zip(timers, before, strict=True):
            signal.setitimer(timer, 0)
            signal.signal(number, handler)


def places(node, path=()):
    """Paths of all nodes of a tree."""
    yield path
    if isinstance(node, (dict, list)):
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            yield from places(value, (*path, key))


def spoil(data, tree):
    """One change somewhere in a tree."""
    path = data.draw(st.sampled_from([path for path in places(tree) if path]))
    holder = tree
    for key in path[:-1]:
        holder = holder[key]
    how = data.draw(st.sampled_from(["delete", "replace", "rename", "double", "nest", "move"]))
    value = holder[path[-1]]
    if how == "delete":
        del holder[path[-1]]
    elif how == "rename" and isinstance(holder, dict):
        holder[data.draw(words | st.text(max_size=8))] = holder.pop(path[-1])
    elif how == "double" and isinstance(holder, list):
        holder.insert(path[-1], copy.deepcopy(value))
    elif how == "nest":
        for _ in range(data.draw(st.sampled_from([1, 2, 40, 200]))):
            value = [value] if data.draw(st.booleans()) else {"a": value}
        holder[path[-1]] = value
    elif how == "move":
        other = data.draw(st.sampled_from([p for p in places(tree) if p]))
        place = tree
        for key in other[:-1]:
            place = place[key]
        holder[path[-1]] = copy.deepcopy(place[other[-1]])
    else:
        holder[path[-1]] = data.draw(small)


class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
    """The key `on` stays a word, as geoident reads it."""

    yaml_implicit_resolvers: ClassVar = {
        first: [one for one in known if not one[0].endswith(":bool") or first in "tTfF"]
        for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


def loaded(text):
    return yaml.load(text, Loader)


def dumped(tree):
    return yaml.dump(tree, Dumper=DUMPER, allow_unicode=True, sort_keys=False)


def spoiled(data, sound):
    """The text of a case with up to four changes."""
    tree = copy.deepcopy(sound)
    for _ in range(data.draw(st.integers(1, 4))):
        if isinstance(tree, (dict, list)) and tree:
            spoil(data, tree)
    return dumped(tree)


def points(tree):
    """One place for each use of a point: its path, with the path of what is of its kind."""
    found = {}
    for path in places(tree):
        node, kind = tree, ""
        for key in path:
            node = node[key]
            kind = node.get("kind", kind) if isinstance(node, dict) else kind
        plain = isinstance(node, list) and all(not isinstance(x, (list, dict)) for x in node)
        if plain and len(node) in (2, 3) and any(" m" in str(x) for x in node):
            words = tuple(key for key in path[2:] if isinstance(key, str))
            found.setdefault((path[0], str(kind), words, path[-1], len(node)), path)
    return found


@functools.cache
def shortest_cases():
    """The shortest case with each use of a point: longer ones are read by the same lines."""
    found = {}
    for path in sorted(SHIPPED, key=lambda path: path.stat().st_size):
        for use in points(loaded(path.read_text(encoding="utf-8"))):
            found.setdefault(use, path)
    return found


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.parent.name)
def test_points_of_another_dimension(path):
    """One coordinate less, one more, one, and none, of each point alone."""
    sound = loaded(path.read_text(encoding="utf-8"))
    sound["readings"] = []  # no point is in them, and a workbook is long to read
    for use, place in points(sound).items():
        if shortest_cases()[use] != path:
            continue
        point = sound
        for key in place:
            point = point[key]
        for count in sorted({0, 1, len(point) - 1, len(point) + 1}):
            tree = copy.deepcopy(sound)
            holder = tree
            for key in place[:-1]:
                holder = holder[key]
            holder[place[-1]] = [*point, "1 m"][:count]
            with contextlib.suppress(InputError):
                parse_case(dumped(tree), str(path))


def test_every_use_of_a_point_is_tried():
    """In 2 and 3 dimensions; cases share many."""
    assert {use[-1] for use in shortest_cases()} == {2, 3}
    assert len(shortest_cases()) > 20
    assert set(shortest_cases().values()) <= set(SHIPPED)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.parent.name)
def test_shipped_cases(path):
    sound = loaded(path.read_text(encoding="utf-8"))
    workbook = "xlsx" in str(sound.get("readings"))  # long to read

    @settings(FUZZ, max_examples=EXAMPLES // 3 if workbook else EXAMPLES)
    @given(st.data())
    def run(data):
        with contextlib.suppress(InputError), within(SECONDS):
            parse_case(spoiled(data, sound), str(path))

    run()


def test_a_case_with_its_mesh(tmp_path):
    """To the end of the check: stages, gauges, loads and mechanisms are looked at too."""
    case, sound = write_case(tmp_path), loaded(CASE)

    @FUZZ
    @given(st.data())
    def run(data):
        case.write_text(spoiled(data, sound), encoding="utf-8", errors="surrogatepass")
        with contextlib.suppress(GeoidentError), within(SECONDS):
            check(str(case))

    run()


@FUZZ
@given(st.data())
def test_readings(data):
    rows = [line.split(",") for line in READINGS.splitlines()]
    for _ in range(data.draw(st.integers(1, 6))):
        row = data.draw(st.sampled_from(rows))
        cell = data.draw(st.integers(0, len(row)))
        value = str(data.draw(scalars))
        row[cell:] = data.draw(
            st.sampled_from([[value, *row[cell + 1 :]], [value, *row[cell:]], row[cell + 1 :], []])
        )
        rows += [list(row)] * data.draw(st.sampled_from([0, 0, 1, 1000]))
    join = data.draw(st.sampled_from([",", ",", ";", "\t", " , "]))
    ends = data.draw(st.sampled_from(["\n", "\n", "\r\n", "\r", "\n\n"]))
    text = ends.join(join.join(row) for row in rows)
    content = text.encode(data.draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"])), "replace")
    with contextlib.suppress(InputError), within(SECONDS):
        parse_readings(content, "r.csv")


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "{a: " * 100_000, "- " * 100_000, "a:\n" * 200_000]
)
def test_nothing_is_so_deep_or_long_that_it_hangs(text):
    with pytest.raises(InputError), within(SECONDS):
        parse_case(text, "case.yaml")


MEASURED = """
import resource, subprocess, sys
code = subprocess.run([sys.executable, *sys.argv[1:]]).returncode
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(code)
"""
"""Runs Python and says its largest memory last. A process inherits that of who started it: of the
process of the tests, it would be what tests before it took."""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="limits of POSIX")
def test_long_run_in_bounded_memory():
    number = os.environ.get("GEOIDENT_FUZZ_EXAMPLES", "2000")
    told = subprocess.run(
        [sys.executable, "-c", MEASURED, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__],
        env={**os.environ, "GEOIDENT_FUZZ_EXAMPLES": number},
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )
    assert told.returncode == 0, told.stdout
    peak = int(told.stdout.split()[-1])
    assert peak < MEMORY * (1024 if sys.platform == "darwin" else 1)
