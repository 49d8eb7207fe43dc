"""Methods of dataclasses that are compiled when they are first called are those of Python."""

import copy
import dataclasses
import gc
import pickle
from dataclasses import InitVar, dataclass, field

import pytest

from geoident import spare_imports

needs_the_maker = pytest.mark.skipif(
    not hasattr(dataclasses, "_create_fn"), reason="this Python compiles a class at once"
)


def defined():
    """Dataclasses of all kinds."""

    @dataclass(frozen=True)
    class Frozen:
        a: int
        b: tuple[int, ...] = (1, 2)
        c: list[int] = field(default_factory=list, compare=False)

    @dataclass(order=True)
    class Ordered:
        a: int
        b: float = field(default=2.0, repr=False)

    @dataclass(frozen=True)
    class Derived(Frozen):
        d: str = "d"

        def __post_init__(self):
            if not self.d:
                raise ValueError("empty")

    @dataclass(slots=True, kw_only=True, unsafe_hash=True)
    class Slotted:
        a: int
        given: InitVar[int] = 0

        def __post_init__(self, given):
            self.a += given

    @dataclass(eq=False)
    class Own:
        a: int

        def __repr__(self):
            return "own"

    class Below(Own):
        def __init__(self):
            super().__init__(7)

    return Frozen, Ordered, Derived, Slotted, Own, Below


def said_of(kinds):
    """What instances of them do, and how they refuse."""
    Frozen, Ordered, Derived, Slotted, Own, Below = kinds

    def refused(function):
        try:
            return function()
        except Exception as error:
            return type(error), str(error)

    one, other = Frozen(1), Frozen(1, (1, 2), [5])
    derived = Derived(1, d="x")
    slotted = Slotted(a=1, given=2)
    return [
        repr(one).rpartition(".")[2], one == other, hash(one) == hash(other), one == derived,
        refused(lambda: setattr(one, "a", 2)), refused(lambda: delattr(one, "a")),
        refused(lambda: setattr(derived, "e", 2)), refused(lambda: Derived(1, d="")),
        refused(Frozen), refused(lambda: Frozen(1, f=2)), dataclasses.replace(other, a=3).c,
        dataclasses.asdict(derived), one != 3, one.__eq__(3) is NotImplemented,
        Ordered(1) < Ordered(2), Ordered(1, 3.0) <= Ordered(1, 2.0), Ordered(2) > Ordered(1),
        repr(Ordered(1)).rpartition(".")[2], refused(lambda: Ordered(1) < 3),
        refused(lambda: hash(Ordered(1))),
        slotted.a, hash(slotted) == hash(Slotted(a=3)), copy.copy(slotted) == slotted,
        refused(lambda: Slotted(1)), repr(Own(1)), Own(1) == Own(1), Below().a,
        [name for name in ("__init__", "__eq__") if vars(Own).get(name)],
        Frozen.__init__.__qualname__.rpartition(">")[2],
    ]  # fmt: skip


@needs_the_maker
def test_methods_that_are_made_when_called_do_what_those_of_python_do(monkeypatch):
    plain, created, asked = said_of(defined()), [], []
    create = dataclasses._create_fn

    def counted(name, *said, **given):
        created.append(name)
        return create(name, *said, **given)

    later = spare_imports._made_when_called(counted)

    def asking(name, *said, **given):
        asked.append(name)
        return later(name, *said, **given)

    monkeypatch.setattr(dataclasses, "_create_fn", asking)
    kinds = defined()
    assert len(asked) > 20
    assert not created
    assert said_of(kinds) == plain
    before = len(created)
    assert said_of(kinds) == plain
    assert len(created) == before  # each once


@dataclass(frozen=True)
class Travels:
    """One that pickle finds again."""

    a: int


@needs_the_maker
def test_a_method_stands_in_its_class_from_its_first_call_on(monkeypatch):
    create = dataclasses._create_fn
    monkeypatch.setattr(dataclasses, "_create_fn", spare_imports._made_when_called(create))
    Frozen, *_ = defined()
    put_off = vars(Frozen)["__init__"]
    Frozen(1)
    made = vars(Frozen)["__init__"]
    assert made is not put_off
    assert made.__code__.co_varnames[:3] == ("self", "a", "b")
    assert put_off(Frozen(2), 3) is None  # who has taken it before can still call it


def test_what_is_pickled_comes_back():
    assert pickle.loads(pickle.dumps(Travels(3))) == Travels(3)


@needs_the_maker
def test_imports_are_spared_once(monkeypatch):
    monkeypatch.setattr(dataclasses, "_create_fn", dataclasses._create_fn)
    monkeypatch.setattr("sys.meta_path", [])
    spare_imports.spare_imports()
    once = dataclasses._create_fn
    spare_imports.spare_imports()
    assert dataclasses._create_fn is once


def test_nobody_looks_for_garbage_meanwhile_and_later_not_among_what_is_there():
    gc.unfreeze()
    with spare_imports.without_search():
        assert not gc.isenabled()
        kept = [[] for _ in range(1000)]
    try:
        assert gc.isenabled()
        assert gc.get_freeze_count() > len(kept)
    finally:
        gc.unfreeze()


def test_who_has_switched_the_search_off_finds_it_so():
    gc.disable()
    try:
        with spare_imports.without_search():
            pass
        assert not gc.isenabled()
    finally:
        gc.unfreeze()
        gc.enable()
