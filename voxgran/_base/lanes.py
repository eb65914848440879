"""Eight words of a row at once: vector instructions for kernels on bit columns.

numba's compiler does not turn loops over short rows into vector instructions; these are written out for it. Where a
processor has narrower vectors the compiler splits them.
"""

from typing import Any

from voxgran._base.kernels import instruction
from voxgran._base.lazy import load

#: words that are treated at once
LANES = 8


@instruction
def meets_lanes(_, bits, here, under, old, old_under, canvas, cell, shift, old_shift):  # type: ignore[no-untyped-def]
    """Return which of eight columns meet taken voxels of the canvas with bits that they did not have before."""
    types, ir = load("numba").types, load("llvmlite.ir")
    takes = (bits, here, under, old, old_under, canvas, cell, shift, old_shift)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        new, gone = _columns(context, builder, signature, args)
        taken = builder.load(_place(context, builder, signature.args[5], args[5], args[6]), align=8)
        met = builder.and_(builder.and_(new, builder.not_(gone)), taken)
        nothing = ir.Constant(_vector(), [0] * LANES)
        return builder.bitcast(builder.icmp_unsigned("!=", met, nothing), ir.IntType(LANES))

    return types.uint8(*takes), generate


@instruction
def flip_lanes(_, bits, here, under, old, old_under, canvas, cell, shift, old_shift):  # type: ignore[no-untyped-def]
    """Flip those bits of eight columns on the canvas that they have now and did not have before, or the reverse."""
    types = load("numba").types
    takes = (bits, here, under, old, old_under, canvas, cell, shift, old_shift)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        new, gone = _columns(context, builder, signature, args)
        place = _place(context, builder, signature.args[5], args[5], args[6])
        builder.store(builder.xor(builder.load(place, align=8), builder.xor(new, gone)), place, align=8)
        return context.get_dummy_value()

    return types.void(*takes), generate


def _vector() -> Any:
    """Return the type of eight words."""
    ir = load("llvmlite.ir")
    return ir.VectorType(ir.IntType(64), LANES)


def _place(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Return where eight words of a flat array begin."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _vector().as_pointer())


def _columns(context: Any, builder: Any, signature: Any, args: Any) -> tuple[Any, Any]:
    """Return eight columns now and before, each shifted up, with what comes from the words below them."""
    ir, vector = load("llvmlite.ir"), _vector()
    joined = ir.FunctionType(vector, [vector] * 3)
    shifted = load("numba.core.cgutils").get_or_insert_function(builder.module, joined, "llvm.fshl.v8i64")

    def rows(above: Any, below: Any, shift: Any) -> Any:
        words = [
            builder.load(_place(context, builder, signature.args[0], args[0], at), align=8) for at in (above, below)
        ]
        first = builder.insert_element(ir.Constant(vector, ir.Undefined), shift, ir.Constant(ir.IntType(32), 0))
        lanes = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.call(shifted, [*words, builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), lanes)])

    return rows(args[1], args[2], args[7]), rows(args[3], args[4], args[8])
