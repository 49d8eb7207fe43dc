"""Whatever a file holds, reading it ends with a case or with faults."""

import contextlib

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geoident.errors import InputError
from geoident.io.readings.file import parse_readings
from geoident.io.text.overrides import apply_overrides
from geoident.io.text.text_file import decode
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.case import format_path
from geoident.units import UnitError, read_quantity

QUICK = settings(
    max_examples=20,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
BITS = ["", "~", "[]", "{}", "[1]", "{a: 1}", "$x", "$K0", "-1", "1e9", "nan", "1 m", "2 GPa"]
BITS += ["virgin", "absent", "rock", "x", ":", "'", '"', "*a", "&a b", "!x", "- ", "\n", "#", "é"]
texts = st.text(max_size=30)


@QUICK
@given(data=st.data())
def test_spoiled_cases(data, project):
    text = project.read().text
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(start, min(len(text), start + 30)))
        text = text[:start] + data.draw(st.sampled_from(BITS) | texts) + text[end:]
    with contextlib.suppress(InputError, UnicodeEncodeError):
        project.read(text.encode("utf-8").decode("utf-8"))


@QUICK
@given(data=st.data())
def test_spoiled_values(data, project):
    """Whole values are replaced, so that the text stays YAML and the checks behind are reached."""
    loaded = project.read()
    paths = sorted(loaded.case.source.positions, key=str)
    chosen = data.draw(st.lists(st.sampled_from(paths), min_size=1, max_size=3))
    overrides = [f"{format_path(path)}={data.draw(st.sampled_from(BITS))}" for path in chosen]
    with contextlib.suppress(InputError):
        project.read(loaded.text, *overrides)


@QUICK
@given(content=st.binary(max_size=60) | texts.map(lambda text: text.encode("utf-8", "ignore")))
def test_any_bytes(content):
    with contextlib.suppress(InputError):
        parse_yaml(decode(content, "case.yaml"), "case.yaml")
    for head in (b"", b"gauge,stage,value,unit,accuracy\n"):
        with contextlib.suppress(InputError):
            parse_readings(head + content, "r.csv")


@QUICK
@given(text=texts, value=texts)
def test_any_override_and_quantity(text, value):
    document = parse_yaml("a: {b: [1, 2]}\nfit: 3", "case.yaml")
    for override in (text, f"{text}={value}", f"a.b[{text}]={value}", f"fit.{text}.x={value}"):
        with contextlib.suppress(InputError):
            apply_overrides(document, [override])
    with contextlib.suppress(UnitError):
        read_quantity(text)
