"""Tiles of products of large matrices, for kernels: several times as fast as loops, and the same bits everywhere.

A tile of four rows and twelve columns stays in registers, four numbers in each. Products are added with one rounding,
which numba's own loops never do (fused multiplication and addition; all processors of x86-64-v3 have it).
"""

from typing import Any

from voxgran._base.kernels import instruction
from voxgran._base.lazy import load

#: rows of a tile
ROWS = 4
#: numbers in a register
LANES = 4
#: columns of a tile
COLUMNS = 3 * LANES


def padded(count: int, step: int) -> int:
    """Return the least multiple of a step that is not below a count."""
    return -(-count // step) * step


@instruction
def add_tile(_: Any, out: Any, a: Any, strip: Any, row: Any, column: Any, begin: Any, terms: Any) -> Any:
    """Add to a tile of `out` the product of its rows of `a`, over the first columns, and of rows of `strip`.

    out: (n, m) float64, in which the tile begins at a row and a column.  a: (n, k) float64.  strip: (l, COLUMNS)
    float64, of which so many rows from `begin` on are the columns of the tile in the other factor. All in C order.
    """
    return load("numba").types.void(out, a, strip, row, column, begin, terms), _tile


def _tile(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    """Write the code of a tile."""
    ir, cgutils = load("llvmlite.ir"), load("numba.core.cgutils")
    vector = ir.VectorType(ir.DoubleType(), LANES)
    row, column, begin, terms = args[3:]
    takes = ir.FunctionType(vector, [vector] * 3)
    fused = cgutils.get_or_insert_function(builder.module, takes, f"llvm.fma.v{LANES}f64")
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    arrays = [context.make_array(signature.args[k])(context, builder, args[k]) for k in range(3)]

    def place(which: int, line: Any, at: Any) -> Any:
        width = cgutils.unpack_tuple(builder, arrays[which].shape)[1]
        return builder.gep(arrays[which].data, [builder.add(builder.mul(line, width), at)])

    def number(value: int) -> Any:
        return ir.Constant(ir.IntType(64), value)

    def vector_at(pointer: Any) -> Any:
        return builder.bitcast(pointer, vector.as_pointer())

    sums = [[cgutils.alloca_once(builder, vector) for _ in range(COLUMNS // LANES)] for _ in range(ROWS)]
    for line in sums:
        for total in line:
            builder.store(ir.Constant(vector, [0.0] * LANES), total)
    with cgutils.for_range(builder, terms) as loop:
        line_of = builder.gep(arrays[2].data, [builder.mul(builder.add(begin, loop.index), number(COLUMNS))])
        across = [
            builder.load(vector_at(builder.gep(line_of, [number(LANES * part)])), align=8)
            for part in range(COLUMNS // LANES)
        ]
        for r, line in enumerate(sums):
            factor = builder.load(place(1, builder.add(row, number(r)), loop.index))
            alone = builder.insert_element(ir.Constant(vector, ir.Undefined), factor, ir.Constant(ir.IntType(32), 0))
            spread = builder.shuffle_vector(alone, ir.Constant(vector, ir.Undefined), lanes)
            for total, other in zip(line, across, strict=True):
                builder.store(builder.call(fused, [spread, other, builder.load(total)]), total)
    for r, line in enumerate(sums):
        for part, total in enumerate(line):
            at = vector_at(place(0, builder.add(row, number(r)), builder.add(column, number(LANES * part))))
            builder.store(builder.fadd(builder.load(at, align=8), builder.load(total)), at, align=8)
    return context.get_dummy_value()
