"""Several numbers at once: the vector units of the processor, for compiled code.

A quad is four doubles side by side, one sphere's x, y, z and a fourth number; rows are the quads of
eight spheres; a lane holds one quantity of eight pairs. All are added, multiplied and compared in one
operation, which LLVM cuts into what the processor has. ``across`` leads from rows to four lanes and
``along`` back. ``root``, ``choose`` and the operators work on floats too, so that a law is written once
for floats and lanes. No bounds are checked here.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel.models import PrimitiveModel
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic as _intrinsic
from numba.extending import lower_builtin, register_model

intrinsic: Any = _intrinsic  # whose own type knows only what Python would call
PAIRS = 8
"""Pairs in one lane."""
_INT, _F = ir.IntType(32), types.float64


class VectorType(types.Type):
    """The compiler's name for so many doubles side by side."""

    def __init__(self, length: int) -> None:
        self.length = length
        super().__init__(name=f"Vector{length}")


def _llvm(kind: VectorType) -> Any:
    return ir.VectorType(ir.DoubleType(), kind.length)


@register_model(VectorType)
class _VectorModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: VectorType) -> None:
        super().__init__(manager, kind, _llvm(kind))


QUAD, LANE, ROWS = VectorType(4), VectorType(PAIRS), VectorType(4 * PAIRS)


def _shuffled(builder: Any, a: Any, b: Any, lanes: tuple[int, ...]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_INT, len(lanes)), list(lanes)))


def _nothing(kind: VectorType) -> Any:
    return ir.Constant(_llvm(kind), ir.Undefined)


def _spread(builder: Any, x: Any, kind: VectorType) -> Any:
    empty = _nothing(kind)
    return _shuffled(builder, builder.insert_element(empty, x, _INT(0)), empty, (0,) * kind.length)


def _operate(name: str) -> Callable[..., Any]:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vectors = [
            arg if kind == sig.return_type else _spread(builder, context.cast(builder, arg, kind, _F), sig.return_type)
            for kind, arg in zip(sig.args, args, strict=True)
        ]
        return getattr(builder, name)(*vectors)

    return lower


for _symbol, _in_place, _name in (
    (operator.add, operator.iadd, "fadd"),
    (operator.sub, operator.isub, "fsub"),
    (operator.mul, operator.imul, "fmul"),
    (operator.truediv, operator.itruediv, "fdiv"),
):
    _cases = [(kind, *args) for kind in (QUAD, LANE, ROWS) for args in ((kind, kind), (_F, kind), (kind, _F))]
    for _form in (_symbol, _in_place):
        _signatures = [signature(*case) for case in _cases]
        infer_global(_form)(type(f"_Vector_{_name}", (ConcreteTemplate,), {"cases": _signatures}))
        for _case in _cases:
            lower_builtin(_form, *_case[1:])(_operate(_name))


def _place_of(context: Any, builder: Any, sig: Any, args: Any, kind: VectorType) -> Any:
    numbers = context.make_array(sig.args[0])(context, builder, args[0])
    index = context.cast(builder, args[1], sig.args[1], types.intp)
    return builder.bitcast(builder.gep(numbers.data, [index]), _llvm(kind).as_pointer())


def _loader(kind: VectorType) -> Any:
    @intrinsic
    def load(context, numbers, index):  # type: ignore[no-untyped-def]
        def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
            return builder.load(_place_of(context, builder, sig, args, kind), align=8)

        return kind(numbers, index), lower

    return load


load = _loader(QUAD)
"""``load(numbers, index)``: the quad ``numbers[index : index + 4]`` of a flat array."""
load_lane = _loader(LANE)
"""``load_lane(numbers, index)``: the lane ``numbers[index : index + 8]`` of a flat array."""


def _row_places(context: Any, builder: Any, sig: Any, args: Any) -> list[Any]:
    """Return where the eight quads ``numbers[width * index[k + l] + offset]`` begin."""
    numbers, index, k, width, offset = args[:5]
    data = context.make_array(sig.args[0])(context, builder, numbers).data
    order = context.make_array(sig.args[1])(context, builder, index).data
    k, width, offset = (
        context.cast(builder, one, kind, types.intp)
        for one, kind in zip((k, width, offset), sig.args[2:5], strict=True)
    )
    places = []
    for lane in range(PAIRS):
        sphere = builder.load(builder.gep(order, [builder.add(k, ir.IntType(64)(lane))]))
        start = builder.add(builder.mul(builder.zext(sphere, ir.IntType(64)), width), offset)
        places.append(builder.bitcast(builder.gep(data, [start]), _llvm(QUAD).as_pointer()))
    return places


@intrinsic
def rows(context, numbers, index, k, width, offset):  # type: ignore[no-untyped-def]
    """Return the quads that begin at ``numbers[width * index[k + l] + offset]``, l from 0 to 7.

    ``index`` holds unsigned 32-bit integers.
    """

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        quads = [builder.load(place, align=8) for place in _row_places(context, builder, sig, args)]
        twos = [_shuffled(builder, quads[k], quads[k + 1], tuple(range(8))) for k in range(0, PAIRS, 2)]
        return _joined(builder, twos)

    return ROWS(numbers, index, k, width, offset), lower


def _joined(builder: Any, twos: list[Any]) -> Any:
    first, last = (_shuffled(builder, twos[k], twos[k + 1], tuple(range(16))) for k in (0, 2))
    return _shuffled(builder, first, last, tuple(range(32)))


@intrinsic
def add_rows(context, numbers, index, k, width, offset, rows):  # type: ignore[no-untyped-def]
    """Add eight quads to where ``rows`` reads them, one after the other."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        for lane, place in enumerate(_row_places(context, builder, sig, args)):
            more = _shuffled(builder, args[5], _nothing(ROWS), tuple(range(4 * lane, 4 * lane + 4)))
            builder.store(builder.fadd(builder.load(place, align=8), more), place, align=8)
        return context.get_dummy_value()

    return types.none(numbers, index, k, width, offset, rows), lower


@intrinsic
def store(context, numbers, index, vector):  # type: ignore[no-untyped-def]
    """Write a quad or a lane into a flat array from ``index`` on."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        builder.store(args[2], _place_of(context, builder, sig, args, sig.args[2]), align=8)
        return context.get_dummy_value()

    return types.none(numbers, index, vector), lower


def _spreader(kind: VectorType) -> Any:
    @intrinsic
    def spread(context, x):  # type: ignore[no-untyped-def]
        def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
            return _spread(builder, args[0], kind)

        return kind(_F), lower

    return spread


spread = _spreader(QUAD)
"""``spread(x)``: a quad with ``x`` four times."""
spread_lane = _spreader(LANE)
"""``spread_lane(x)``: a lane with ``x`` eight times."""


@intrinsic
def repeat(context, quad):  # type: ignore[no-untyped-def]
    """Return rows that are all the same quad."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        return _shuffled(builder, args[0], _nothing(QUAD), (0, 1, 2, 3) * PAIRS)

    return ROWS(QUAD), lower


@intrinsic
def fourth(context, rows):  # type: ignore[no-untyped-def]
    """Return rows with each quad's fourth number four times."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        lanes = tuple(4 * (k // 4) + 3 for k in range(4 * PAIRS))
        return _shuffled(builder, args[0], _nothing(ROWS), lanes)

    return ROWS(ROWS), lower


@intrinsic
def quad(context, x, y, z, w):  # type: ignore[no-untyped-def]
    """Return a quad of four floats."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        out = _nothing(QUAD)
        for k, number in enumerate(args):
            out = builder.insert_element(out, number, _INT(k))
        return out

    return QUAD(_F, _F, _F, _F), lower


@intrinsic
def total(context, a):  # type: ignore[no-untyped-def]
    """Return the sum of a quad's four numbers, the halves first."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        halves = builder.fadd(args[0], _shuffled(builder, args[0], _nothing(QUAD), (2, 3, 2, 3)))
        return builder.fadd(*(builder.extract_element(halves, _INT(k)) for k in (0, 1)))

    return _F(QUAD), lower


_EVEN, _ODD = (0, 8, 2, 10, 4, 12, 6, 14), (1, 9, 3, 11, 5, 13, 7, 15)
_HALVES = (0, 1, 8, 9, 2, 3, 10, 11), (4, 5, 12, 13, 6, 7, 14, 15)


@intrinsic
def across(context, rows):  # type: ignore[no-untyped-def]
    """Return four lanes, the k-th of which holds the k-th numbers of eight quads."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        twos = [_shuffled(builder, args[0], _nothing(ROWS), tuple(range(8 * k, 8 * k + 8))) for k in range(4)]
        columns: dict[int, Any] = {}
        for which, lanes in ((0, _EVEN), (1, _ODD)):
            # rows 0 2 1 3 and 4 6 5 7, of each quad its even or its odd numbers
            first, last = (_shuffled(builder, twos[k], twos[k + 1], lanes) for k in (0, 2))
            columns[which] = _shuffled(builder, first, last, (0, 4, 1, 5, 8, 12, 9, 13))
            columns[which + 2] = _shuffled(builder, first, last, (2, 6, 3, 7, 10, 14, 11, 15))
        return context.make_tuple(builder, sig.return_type, [columns[k] for k in range(4)])

    return types.UniTuple(LANE, 4)(ROWS), lower


@intrinsic
def along(context, a, b, c, d):  # type: ignore[no-untyped-def]
    """Return rows, the k-th of which holds the k-th numbers of four lanes: ``across`` undone."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        xy = [_shuffled(builder, args[0], args[1], lanes) for lanes in (_EVEN, _ODD)]
        zw = [_shuffled(builder, args[2], args[3], lanes) for lanes in (_EVEN, _ODD)]
        # xy[0]: x y of rows 0 2 4 6; xy[1]: of rows 1 3 5 7
        evens = [_shuffled(builder, xy[0], zw[0], lanes) for lanes in _HALVES]
        odds = [_shuffled(builder, xy[1], zw[1], lanes) for lanes in _HALVES]
        low, high = (0, 1, 2, 3, 8, 9, 10, 11), (4, 5, 6, 7, 12, 13, 14, 15)
        twos = [_shuffled(builder, evens[k], odds[k], half) for k in (0, 1) for half in (low, high)]
        return _joined(builder, twos)

    return ROWS(LANE, LANE, LANE, LANE), lower


def _one_by_one(name: str) -> Any:
    """Return an intrinsic that calls LLVM's function of this name on a float or on each of a vector."""

    @intrinsic
    def call(context, a):  # type: ignore[no-untyped-def]
        def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
            suffix = f"v{sig.args[0].length}f64" if isinstance(sig.args[0], VectorType) else "f64"
            kind = args[0].type
            function = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(kind, [kind]), f"llvm.{name}.{suffix}"
            )
            return builder.call(function, args)

        return a(a), lower

    return call


root = _one_by_one("sqrt")
nearest = _one_by_one("rint")
size = _one_by_one("fabs")
rounded = _one_by_one("arithmetic.fence")
"""Keeps a product from being fused with the sum that it goes into: equal bytes whoever adds it."""


@intrinsic
def choose(context, a, b, x, y):  # type: ignore[no-untyped-def]
    """Return ``x`` where ``a < b``, else ``y``, one by one; both are computed."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        return builder.select(builder.fcmp_ordered("<", args[0], args[1]), args[2], args[3])

    return x(a, b, x, y), lower


@intrinsic
def any_below(context, a, b):  # type: ignore[no-untyped-def]
    """Return whether ``a < b`` anywhere in a lane."""

    def lower(context, builder, sig, args):  # type: ignore[no-untyped-def]
        mask = ir.IntType(PAIRS)
        return builder.icmp_unsigned("!=", builder.bitcast(builder.fcmp_ordered("<", args[0], args[1]), mask), mask(0))

    return types.boolean(LANE, LANE), lower
