"""Eight words of a row at once: vector instructions for kernels on bit columns.

numba's compiler does not turn loops over short rows into vector instructions; these are written out for it. Where a
processor has narrower vectors the compiler splits them.
"""

from collections.abc import Callable
from typing import Any

from voxgran._base.kernels import Instruction, instruction
from voxgran._base.lazy import load

#: words that are treated at once
LANES = 8


#: context, builder, type of the bits, the bits, where a row begins, what is under it or which part, and the shift
Columns = Callable[[Any, Any, Any, Any, Any, Any, Any], Any]


def _meeting(columns: Columns) -> Callable[..., Any]:
    """Return what writes the code of a test."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        ir = load("llvmlite.ir")
        new, gone = _both(columns, context, builder, signature, args)
        taken = builder.load(_place(context, builder, signature.args[5], args[5], args[6]), align=8)
        met = builder.and_(builder.and_(new, builder.not_(gone)), taken)
        nothing = ir.Constant(_vector(), [0] * LANES)
        return builder.bitcast(builder.icmp_unsigned("!=", met, nothing), ir.IntType(LANES))

    return generate


def _flipping(columns: Columns) -> Callable[..., Any]:
    """Return what writes the code of a stamp."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        new, gone = _both(columns, context, builder, signature, args)
        place = _place(context, builder, signature.args[5], args[5], args[6])
        builder.store(builder.xor(builder.load(place, align=8), builder.xor(new, gone)), place, align=8)
        return context.get_dummy_value()

    return generate


def _both(columns: Columns, context: Any, builder: Any, signature: Any, args: Any) -> tuple[Any, Any]:
    """Return eight columns now and before."""
    bits = signature.args[0], args[0]
    return (
        columns(context, builder, *bits, args[1], args[2], args[7]),
        columns(context, builder, *bits, args[3], args[4], args[8]),
    )


def _joined(context: Any, builder: Any, kind: Any, bits: Any, at: Any, under: Any, shift: Any) -> Any:
    """Return eight words shifted up, with what comes from the words under them."""
    words = [builder.load(_place(context, builder, kind, bits, place), align=8) for place in (at, under)]
    return builder.call(_shifted(builder), [*words, _spread(builder, shift)])


def _turned(context: Any, builder: Any, kind: Any, bits: Any, at: Any, part: Any, shift: Any) -> Any:
    """Return eight words turned up, and of that the bits of a part."""
    words = builder.load(_place(context, builder, kind, bits, at), align=8)
    turned = builder.call(_shifted(builder), [words, words, _spread(builder, shift)])
    return builder.and_(turned, _spread(builder, part))


def _vector() -> Any:
    """Return the type of eight words."""
    ir = load("llvmlite.ir")
    return ir.VectorType(ir.IntType(64), LANES)


def _shifted(builder: Any) -> Any:
    """Return the instruction that shifts pairs of words up and keeps the upper ones."""
    ir, vector = load("llvmlite.ir"), _vector()
    takes = ir.FunctionType(vector, [vector] * 3)
    return load("numba.core.cgutils").get_or_insert_function(builder.module, takes, "llvm.fshl.v8i64")


def _spread(builder: Any, word: Any) -> Any:
    """Return a word eight times."""
    ir, vector = load("llvmlite.ir"), _vector()
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), word, ir.Constant(ir.IntType(32), 0))
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), lanes)


def _place(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Return where eight words of a flat array begin."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _vector().as_pointer())


def _lanes(code: Callable[[Columns], Callable[..., Any]], columns: Columns) -> Instruction:
    """Return the instruction that looks at eight columns, or flips them."""

    @instruction
    def lanes(
        _: Any, bits: Any, here: Any, under: Any, old: Any, old_under: Any, canvas: Any, cell: Any, shift: Any,
        old_shift: Any,
    ) -> Any:  # fmt: skip
        """Take the words of columns, where they begin now and before, the canvas and by how much they are shifted."""
        types = load("numba").types
        gives = types.uint8 if code is _meeting else types.void
        return gives(bits, here, under, old, old_under, canvas, cell, shift, old_shift), code(columns)

    return lanes


#: which of eight columns meet taken voxels of the canvas with bits that they did not have before; a column is a word
#: shifted up, with what comes from the word under it, or of columns one word tall turned up, and of that the bits of a
#: part
meets_lanes, meets_low_lanes = _lanes(_meeting, _joined), _lanes(_meeting, _turned)
#: flip those bits of eight such columns on the canvas that they have now and did not have before, or the reverse
flip_lanes, flip_low_lanes = _lanes(_flipping, _joined), _lanes(_flipping, _turned)
