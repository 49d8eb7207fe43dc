from __future__ import annotations

import dataclasses
import math
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from geoident.errors import InputError, OutputError
from geoident.io.result import hdf5
from geoident.io.result.file import ResultIdentity, read_identity, read_result, write_result
from geoident.io.result.hdf5 import TableWriter, hdf5_output
from geoident.model.results.result import DIAGNOSTIC_COLUMNS, FieldSeries, LastStates, Result
from geoident.model.results.shells import ShellForces
from tests.io.result.conftest import make_result
from tests.support.results import changed_gauges

Make = Callable[..., Result]


def names_in(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A full result, written once."""
    path = tmp_path_factory.mktemp("kept") / "a.h5"
    write_result(make_result(), path, overwrite=False)
    return path


@pytest.fixture
def written(kept: Path, tmp_path: Path) -> Path:
    """A copy of a full result."""
    for name in ("a.h5", "a.vtkhdf"):
        shutil.copy(kept.with_name(name), tmp_path)
    return tmp_path / "a.h5"


def assert_same(a: Any, b: Any, place: str = "result") -> None:
    """Equal to the last bit, types included, NaN equal to NaN."""
    assert type(a) is type(b) or isinstance(a, Mapping), place
    if dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            name = field.name
            assert_same(getattr(a, name), getattr(b, name), f"{place}.{name}")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, place
        np.testing.assert_array_equal(a, b, err_msg=place)
        assert b.flags.writeable == a.flags.writeable
    elif isinstance(a, Mapping):
        assert list(a) == list(b), place
        for key in a:
            assert_same(a[key], b[key], f"{place}[{key}]")
    elif isinstance(a, tuple):
        assert len(a) == len(b), place
        for number, pair in enumerate(zip(a, b, strict=True)):
            assert_same(*pair, f"{place}[{number}]")
    else:
        assert a == b or np.isnan([a, b]).all(), place


@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("dim", [2, 3])
def test_round_trip(tmp_path: Path, result_maker: Make, dim: int, full: bool) -> None:
    result = result_maker(dim, full=full)
    path = tmp_path / "a.fit.h5"
    written = write_result(result, path, overwrite=False)
    names = ["a.fit.h5", "a.fit.vtkhdf"] if full else ["a.fit.h5"]
    assert written == tuple(str(tmp_path / name) for name in names)
    assert names_in(tmp_path) == names
    assert_same(result, read_result(path))


def collapsed(fields: FieldSeries) -> FieldSeries:
    """The last of three states is without equilibrium."""
    rng = np.random.default_rng(3)
    moved, stress = fields.displacement.copy(), fields.stress.copy()
    yielded = fields.yielded.copy()
    moved[2] = stress[2] = np.nan
    yielded[2] = False
    last = LastStates(
        np.array([2]), rng.normal(size=(1, *moved.shape[1:])),
        np.where(np.isnan(fields.stress[2]), np.nan, 1e6)[None],
        rng.random((1, yielded.shape[1])) < 0.5,
    )  # fmt: skip
    return replace(fields, displacement=moved, stress=stress, yielded=yielded, last=last)


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_round_trip_of_a_collapse(tmp_path: Path, result_maker: Make, dim: int) -> None:
    """Viewers are given the last equilibrium; who reads the result knows that there is none."""
    result = result_maker(dim)
    result = replace(result, fields=collapsed(result.fields))
    path = tmp_path / "a.fit.h5"
    write_result(result, path, overwrite=False)
    assert_same(result, read_result(path))
    with h5py.File(path) as file:
        moved = file["VTKHDF/PointData/displacement"][:].reshape(3, -1, 3)[:, :, :dim]
        balanced = file["VTKHDF/CellData/equilibrium"][:].reshape(3, -1)
    np.testing.assert_array_equal(moved[:2], result.fields.displacement[:2])
    np.testing.assert_array_equal(moved[2], result.fields.last.displacement[0])
    assert balanced.min(axis=1).tolist() == balanced.max(axis=1).tolist() == [1, 1, 0]


def test_round_trip_of_nothing(tmp_path: Path, result_maker: Make) -> None:
    """No parameters, no gauges, no stages, an objective that is not a number."""
    result = result_maker(2, full=False)
    cut = {
        name: getattr(result.parameters, name)[:0]
        for name in [f.name for f in dataclasses.fields(result.parameters)]
    }
    cut["covariance"] = cut["correlation"] = np.empty((0, 0))
    empty = np.empty((0, 0))
    gauges = changed_gauges(
        result.gauges,
        channels=(),
        stages=(),
        measured=empty,
        computed=empty,
        sd=empty,
        used=empty.astype(bool),
        bad=empty.astype(bool),
        first=result.gauges.first[:0],
        second=result.gauges.second[:0],
    )
    result = dataclasses.replace(
        result,
        parameters=dataclasses.replace(result.parameters, **cut),
        gauges=gauges,
        objective=float("nan"),
    )
    write_result(result, tmp_path / "a.h5", overwrite=False)
    assert_same(result, read_result(tmp_path / "a.h5"))


def test_scan_over_one_parameter_called_objective(tmp_path: Path, result_maker: Make) -> None:
    result = result_maker(2)
    grid = dataclasses.replace(
        result.grid,
        names=("objective",),
        axes=(np.array([1.0, 2.0]),),
        objective=np.array([3.0, 4.0]),
    )
    result = dataclasses.replace(result_maker(2, full=False), kind="scan", grid=grid)
    write_result(result, tmp_path / "a.h5", overwrite=False)
    assert_same(result, read_result(tmp_path / "a.h5"))


def test_text_that_utf8_cannot_hold_is_escaped(tmp_path: Path, result_maker: Make) -> None:
    result = dataclasses.replace(result_maker(full=False), reason="file \udcff", notes=("a\0b",))
    write_result(result, tmp_path / "a.h5", overwrite=False)
    again = read_result(tmp_path / "a.h5")
    assert again.reason == "file \\udcff"
    assert again.notes == ("a\\x00b",)


def test_equal_input_gives_equal_bytes(tmp_path: Path, result_maker: Make) -> None:
    result = result_maker()
    write_result(result, tmp_path / "a.h5", overwrite=False)
    written = int(time.time())
    while int(time.time()) == written:  # time stamps of HDF5 count seconds
        time.sleep(0.02)
    (tmp_path / "other").mkdir()
    write_result(result, tmp_path / "other" / "a.h5", overwrite=False)
    for name in ("a.h5", "a.vtkhdf"):
        assert (tmp_path / name).read_bytes() == (tmp_path / "other" / name).read_bytes()


def test_root_attributes_say_where_it_comes_from(kept: Path) -> None:
    with h5py.File(kept) as file:
        found = dict(file.attrs)
    assert found["format"] == "geoident-result/2"
    assert found["versions"] == '{"geoident": "0.1.0", "numpy": "2.1"}'
    assert found["mesh_sha256"] == "b" * 64
    assert (found["seed"], found["exit_code"], found["factorizations"]) == (4, 0, 6)
    expected = {"command", "case_sha256", "readings_sha256", "identity", "status", "created"}
    assert expected <= set(found)


def test_identity_of_existing_results(tmp_path: Path, result_maker: Make) -> None:
    path = tmp_path / "a.h5"
    assert read_identity(path) is None
    write_result(result_maker(full=False), path, overwrite=False)
    expected = ResultIdentity(
        "d" * 64, "fit", "converged", 0, "cavern.yaml", math.inf, 3.25,
        contents="case gauges history parameters readings",
    )  # fmt: skip
    assert read_identity(path) == expected
    took = result_maker(full=False)
    provenance = dataclasses.replace(took.provenance, seconds=4000.0)
    took = dataclasses.replace(took, provenance=provenance)
    write_result(took, path, overwrite=True)
    assert read_identity(path) == dataclasses.replace(expected, seconds=4000.0)
    path.write_bytes(path.read_bytes()[:-1])
    assert read_identity(path) is None
    path.write_text("text")
    assert read_identity(path) is None


# Tables as others read them


TABLES = {
    "parameters": {"value": ("parameter",), "covariance": ("parameter", "other")},
    "gauges": {"measured": ("gauge", "stage"), "points": ("gauge", "end", "axis")},
    "sensitivity": {"sensitivity": ("gauge", "stage", "parameter")},
    "history": {"objective": ("iteration",), "values": ("iteration", "parameter")},
    "prediction": {"mean": ("gauge", "stage")},
    "grid": {"objective": ("E_rock", "sigma_v")},
    "yielded": {"volume": ("state",), "upper": ("state", "axis")},
}


@pytest.mark.parametrize(
    "group",
    [  # those with every kind of axis
        name
        if name in ("gauges", "history", "grid", "yielded")
        else pytest.param(name, marks=pytest.mark.slow)
        for name in TABLES
    ],
)
def test_xarray_reads_every_table(kept: Path, group: str) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    with xarray.open_dataset(kept, group=group, engine="h5netcdf") as table:
        table.load()
    for name, dims in TABLES[group].items():
        assert table[name].dims == dims
    for axis in ("gauge", "stage", "parameter"):
        if axis in table.dims:
            assert table[axis].dtype.kind in "UOT"


def test_xarray_selects_by_name(kept: Path) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    result = make_result()
    with xarray.open_dataset(kept, group="gauges", engine="h5netcdf") as table:
        chosen = table["measured"].sel(gauge="EX1.a15", stage="bench 1")
        assert float(chosen) == result.gauges.measured[1, 1]
        assert chosen.attrs["unit"] == "m"
        assert list(table["used"].values[2]) == [0, 1]
        residual = result.gauges.measured - result.gauges.computed
        np.testing.assert_array_equal(table["residual"], residual)
    with xarray.open_dataset(kept, engine="h5netcdf") as root:
        assert root.attrs["status"] == "converged"


def test_only_plain_types_in_contiguous_layout(kept: Path) -> None:
    kinds = set()

    def visit(name: str, item: h5py.HLObject) -> None:
        if isinstance(item, h5py.Dataset):
            kinds.add(item.dtype.str if item.dtype.kind != "O" else "text")
            assert item.chunks is None
            assert item.compression is None

    with h5py.File(kept) as file:
        file.visititems(visit)
    assert kinds == {"<f8", "<i8", "|i1", "|u1", "text"}


# What the reader refuses


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_result(path)
    (fault,) = caught.value.faults
    assert fault.location.file == str(path)
    return str(caught.value)


def test_files_that_are_no_results(tmp_path: Path, result_maker: Make) -> None:
    assert "no such file" in refused(tmp_path / "none.h5")
    assert "not a file" in refused(tmp_path)
    (tmp_path / "text.h5").write_text("gauge,stage,value\n")
    assert "not an HDF5 file" in refused(tmp_path / "text.h5")
    (tmp_path / "case.yaml").write_text("title: mine\nformat: geoident-case/1\n")
    said = refused(tmp_path / "case.yaml")
    assert "is a case; a result is expected" in said
    assert said.endswith(f"writes: {tmp_path / 'case.fit.h5'}")
    (tmp_path / "case.fit.h5").write_text("")
    assert refused(tmp_path / "case.yaml").endswith(f"its result: {tmp_path / 'case.fit.h5'}")
    (tmp_path / "empty.h5").write_text("")
    assert "not an HDF5 file" in refused(tmp_path / "empty.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1.0
    assert "not a result of geoident" in refused(tmp_path / "other.h5")
    write_result(result_maker(), tmp_path / "a.fit.h5", overwrite=False)
    assert "the result is a.fit.h5" in refused(tmp_path / "a.fit.vtkhdf")


@pytest.mark.parametrize("found", ["geoident-result/3", "geoident-result/10"])
def test_unknown_format(tmp_path: Path, result_maker: Make, found: str) -> None:
    write_result(result_maker(full=False), tmp_path / "a.h5", overwrite=False)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file.attrs["format"] = found
    assert f"format '{found}' is not known" in refused(tmp_path / "a.h5")


def test_truncated_at_any_length(written: Path) -> None:
    whole = written.read_bytes()
    for size in [*range(8, len(whole), len(whole) // 17), len(whole) - 1]:
        written.write_bytes(whole[:size])
        assert "truncated" in refused(written)


def pieces(path: Path) -> list[str]:
    names: list[str] = []
    with h5py.File(path) as file:
        file.visit(names.append)
    return names


# what only others read, or what is derived from the rest
UNUSED = ("bound", "end", "other", "iteration", "parameter", "gauge", "stage", "axis", "residual")
UNUSED += ("parameters/unit",)
UNUSED += ("Values", "Offsets", "Types", "vtkGhostType", "CellData/group", "NumberOfCells")
UNUSED += ("NumberOfConnectivityIds", "singular_values")
UNUSED += ("PointData/mechanism", "CellData/mechanism_shear")  # for ParaView; read in /mechanism
WIDE = tuple(f"gauges/{name}" for name in ("measured", "residual", "sd", "used", "bad", "unit"))
WIDE += tuple(f"diagnostics/{name}" for name in (*DIAGNOSTIC_COLUMNS, "influence", "parameter"))
UNUSED += (*WIDE, *(f"readings/{name}" for name in ("residual", "unit", "dimension", "reading")))
UNUSED += ("parameters/prior", "parameters/prior_kind", "diagnostics/gauge", "diagnostics/stage")
UNUSED += ("readings/parameter", "parameters/name")
UNUSED += ("opening/support_pressure", "opening/support_capacity")  # only where there is a support
UNUSED += tuple(f"mechanism/{axis}" for axis in ("node", "element", "component"))


def read_by_us(name: str) -> bool:
    return not name.endswith(UNUSED) and "/Steps/" not in name


@pytest.mark.parametrize("every", [11, pytest.param(1, marks=pytest.mark.slow)])
def test_every_missing_piece_is_named(written: Path, every: int) -> None:
    path, whole = written, written.read_bytes()
    for name in [name for name in pieces(path) if read_by_us(name)][::every]:
        path.write_bytes(whole)
        with h5py.File(path, "a") as file:
            del file[name]
        said = refused(path)
        assert f"/{name} is missing" in said
        assert "an earlier version of geoident may not have had it" in said


@pytest.mark.parametrize("strong", [False, True])
def test_shells_come_back_with_what_is_used_of_them(
    tmp_path: Path, result_maker: Make, *, strong: bool
) -> None:
    result, rng = result_maker(full=True), np.random.default_rng(3)
    stages = result.gauges.stages
    shells = ShellForces(
        ("wall", "wall"), np.array([1, 2]), stages, rng.random((2, 3)), rng.random((2, 4, 3)),
        rng.random((2, 3, 3)), rng.random((2, 3, len(stages))), rng.random((2, 3, len(stages))),
        *((rng.random((2, 3, len(stages))), rng.random((2, len(stages)))) if strong else ()),
    )  # fmt: skip
    write_result(replace(result, shells=shells), tmp_path / "a.h5", overwrite=False)
    found = read_result(tmp_path / "a.h5").shells
    assert found is not None
    for name, value in vars(shells).items():
        np.testing.assert_equal(getattr(found, name), value)


@pytest.mark.parametrize("name", ["identity", "reason", "seed", "versions", "contents", "solves"])
def test_missing_attributes_are_named(tmp_path: Path, result_maker: Make, name: str) -> None:
    write_result(result_maker(full=False), tmp_path / "a.h5", overwrite=False)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file.attrs[name]
    assert f"the attribute '{name}' is missing" in refused(tmp_path / "a.h5")


def test_pieces_of_another_shape_or_type_are_named(written: Path) -> None:
    with h5py.File(written, "a") as file:
        del file["prediction/mean"]
        file["prediction/mean"] = np.zeros((3, 1))
    assert "/prediction/mean has the shape (3, 1), not (3, 2)" in refused(written)
    with h5py.File(written, "a") as file:
        del file["readings/sd"]
        file["readings/sd"] = "text"
    assert "/readings/sd holds object" in refused(written)


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("gauges/gauge", lambda old: old[None], "/gauges/gauge has the shape (1, 3), not (1,)"),
        ("readings/channel", lambda old: np.full(old.shape, "XX", dtype=object), "speaks of 'XX'"),
        ("readings/stage", lambda old: np.full(old.shape, "XX", dtype=object), "speaks of 'XX'"),
        ("VTKHDF/NumberOfPoints", lambda old: np.zeros(0, dtype=np.int64), "damaged"),
    ],
)
def test_parts_that_do_not_go_together_are_refused(
    written: Path, name: str, change: Callable[[Any], Any], said: str
) -> None:
    with h5py.File(written, "a") as file:
        old = file[name][()]
        del file[name]
        file[name] = change(old)
    assert said in refused(written)


def test_a_number_that_is_none_is_refused(written: Path) -> None:
    with h5py.File(written, "a") as file:
        file.attrs["exit_code"] = np.inf
    assert "damaged" in refused(written)


def test_a_file_into_which_something_was_put_is_refused(written: Path) -> None:
    """HDF5 searched some such files without end, and could not be interrupted."""
    whole = written.read_bytes()
    for place in (70, len(whole) // 2, len(whole)):
        written.write_bytes(whole[:place] + b"\xfa" + whole[place:])
        assert "it is longer than it was written" in refused(written)


@pytest.mark.parametrize("count", [8, pytest.param(150, marks=pytest.mark.slow)])
def test_flipped_bytes_are_refused_or_read_but_never_crash(written: Path, count: int) -> None:
    path, whole = written, written.read_bytes()
    rng = np.random.default_rng(1)
    refusals = []
    for place in rng.integers(0, len(whole), count):
        broken = bytearray(whole)
        broken[place] ^= 0xFF
        path.write_bytes(broken)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                read_result(path)
        except InputError as error:
            refusals.append(str(error).startswith(str(path)))
    assert refusals
    assert all(refusals)


# What the writer survives


def test_existing_result_is_kept_without_overwrite(tmp_path: Path, result_maker: Make) -> None:
    path = tmp_path / "a.fit.h5"
    write_result(result_maker(2, full=False), path, overwrite=False)
    before = path.read_bytes()
    with pytest.raises(OutputError, match="exists already"):
        write_result(result_maker(3, full=False), path, overwrite=False)
    assert path.read_bytes() == before
    write_result(result_maker(3, full=False), path, overwrite=True)
    assert_same(result_maker(3, full=False), read_result(path))


def test_sidecar_follows_the_result(tmp_path: Path, result_maker: Make) -> None:
    path, sidecar = tmp_path / "a.fit.h5", tmp_path / "a.fit.vtkhdf"
    write_result(result_maker(), path, overwrite=False)
    path.unlink()
    write_result(result_maker(), path, overwrite=False)  # its own sidecar is no obstacle
    write_result(result_maker(full=False), path, overwrite=True)
    assert not sidecar.exists()
    sidecar.write_text("something else")
    write_result(result_maker(full=False), path, overwrite=True)
    assert sidecar.read_text() == "something else"
    path.unlink()
    with pytest.raises(OutputError, match="vtkhdf: exists already"):
        write_result(result_maker(), path, overwrite=False)
    assert names_in(tmp_path) == ["a.fit.vtkhdf"]


def test_result_named_as_a_sidecar_needs_none(tmp_path: Path, result_maker: Make) -> None:
    path = tmp_path / "a.vtkhdf"
    assert write_result(result_maker(), path, overwrite=False) == (str(path),)
    assert_same(result_maker(), read_result(path))


FULL_DISK = """
import resource, sys
sys.path.insert(0, sys.argv[1])
from conftest import make_result
from geoident.errors import OutputError
from geoident.io.result.file import write_result
for full, size in enumerate(map(int, sys.argv[4:])):
    result = make_result(full=bool(full))
    for limit in range(0, size, size // int(sys.argv[3])):
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        try:
            write_result(result, sys.argv[2], overwrite=True)
        except OutputError as error:
            assert "File too large" in str(error), error
        else:
            raise SystemExit(f"limit {limit} had no effect")
"""


@pytest.mark.parametrize("steps", [5, pytest.param(40, marks=pytest.mark.slow)])
def test_disk_that_is_full_at_any_moment(tmp_path: Path, result_maker: Make, steps: int) -> None:
    """The kernel's limit on file sizes stands for the disk; HDF5 alone ends in a crash."""
    path = tmp_path / "a.h5"
    write_result(result_maker(full=False), path, overwrite=False)
    before = path.read_bytes()
    write_result(result_maker(), tmp_path / "b.h5", overwrite=False)
    sizes = [len(before), (tmp_path / "b.h5").stat().st_size]
    arguments = [str(Path(__file__).parent), str(path), str(steps), *map(str, sizes)]
    run = subprocess.run(
        [sys.executable, "-c", FULL_DISK, *arguments], capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert path.read_bytes() == before
    assert names_in(tmp_path) == ["a.h5", "b.h5", "b.vtkhdf"]


def test_what_is_put_together_in_memory_has_the_same_bytes(
    tmp_path: Path, result_maker: Make
) -> None:
    for small in (False, True):
        path = tmp_path / f"{small}.h5"
        path.touch()
        with hdf5_output(path, small=small) as file:
            for number in range(40):
                table = TableWriter(file, f"table {number}", {"a": ["x", "y"], "b": np.arange(3)})
                table.add("values", np.full((2, 3), 1.5), "a", "b", unit="m")
                table.add("none", np.zeros((0,)))
            file.attrs["text"] = "a" * 3000
    assert (tmp_path / "True.h5").read_bytes() == (tmp_path / "False.h5").read_bytes()


@contextmanager
def interrupts_raise() -> Iterator[None]:
    """Python's own answer to Ctrl-C; a shell that starts us in the background has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_interrupt_waits_until_the_library_is_done(
    tmp_path: Path, result_maker: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = hdf5._Sink._store
    calls, through = [], []

    def interrupted(sink: hdf5._Sink, view: memoryview) -> None:
        calls.append(1)
        if len(calls) == 20:
            signal.raise_signal(signal.SIGINT)
            through.append("no exception in the library")
        store(sink, view)

    monkeypatch.setattr(hdf5._Sink, "_store", interrupted)
    with interrupts_raise(), pytest.raises(KeyboardInterrupt):
        write_result(result_maker(), tmp_path / "a.h5", overwrite=False)
    assert len(calls) > 40
    assert through
    assert names_in(tmp_path) == []


WRITER = """
import sys
sys.path.insert(0, sys.argv[1])
from conftest import make_result
from geoident.io.result.file import write_result
results = [make_result(2), make_result(3)]
print("ready", flush=True)
for turn in range(1, 10**9):
    write_result(results[turn % 2], sys.argv[2], overwrite=True)
"""


def kill_a_writer(path: Path, delay: float) -> None:
    command = [sys.executable, "-c", WRITER, str(Path(__file__).parent), str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(delay)
        process.kill()


def check_kills(path: Path, result_maker: Make, delays: Any) -> None:
    write_result(result_maker(2), path, overwrite=False)
    for delay in delays:
        kill_a_writer(path, delay)
        found = read_result(path)
        assert_same(result_maker(found.gauges.first.shape[1]), found)
    write_result(result_maker(2), path, overwrite=True)
    assert names_in(path.parent) == ["a.h5", "a.vtkhdf"]


def test_kill_leaves_a_complete_result(tmp_path: Path, result_maker: Make) -> None:
    check_kills(tmp_path / "a.h5", result_maker, (0.013,))


@pytest.mark.slow
def test_kill_leaves_a_complete_result_many_times(tmp_path: Path, result_maker: Make) -> None:
    check_kills(tmp_path / "a.h5", result_maker, np.random.default_rng(0).uniform(0, 0.2, 60))
