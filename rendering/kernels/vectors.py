"""Texture filtering and light look-up eight values at a time, as LLVM vector code.

numba compiles scalar code, and LLVM does not find the vectors in it, since it cannot know that
arrays do not overlap. The eight values are the corners of two mip levels' texel squares, and the
corners of a cube of the light grid.
"""

from collections.abc import Sequence
from typing import Any

import llvmlite.ir as ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

I32, I64, F32 = ir.IntType(32), ir.IntType(64), ir.FloatType()
CORNERS = 8
# Corners by the bits of their number: x the lowest, y, then the mip level or z.
_X_OF_LEVELS, _Y_OF_LEVELS = [0, 4, 0, 4, 2, 6, 2, 6], [1, 1, 5, 5, 3, 3, 7, 7]
CONTRACT = ("contract",)


class _Vectors:
    """Builds vector instructions."""

    def __init__(self, builder: Any):
        self.builder = builder

    def constant(self, values: Sequence[float], kind: Any = F32) -> Any:
        return ir.Constant(ir.VectorType(kind, len(values)), list(values))

    def of(self, scalars: Sequence[Any]) -> Any:
        """Return a vector of scalars."""
        vector = ir.Constant(ir.VectorType(scalars[0].type, len(scalars)), ir.Undefined)
        for lane, scalar in enumerate(scalars):
            vector = self.builder.insert_element(vector, scalar, I32(lane))
        return vector

    def pick(self, a: Any, b: Any, lanes: Sequence[int]) -> Any:
        """Return the lanes of `a` followed by `b` with the given numbers."""
        return self.builder.shuffle_vector(a, b, self.constant(lanes, I32))

    def add(self, a: Any, b: Any) -> Any:
        return self.builder.fadd(a, b, flags=CONTRACT)

    def sub(self, a: Any, b: Any) -> Any:
        return self.builder.fsub(a, b, flags=CONTRACT)

    def mul(self, a: Any, b: Any) -> Any:
        return self.builder.fmul(a, b, flags=CONTRACT)

    def floor(self, a: Any) -> Any:
        kind, name = ir.FunctionType(a.type, [a.type]), f"llvm.floor.v{a.type.count}f32"
        function = cgutils.get_or_insert_function(self.builder.module, kind, name)
        return self.builder.call(function, [a])

    def load(self, address: Any, index: Any, kind: Any, stride: int) -> Any:
        """Return a value of a type at `address` + `stride` · `index` bytes, not aligned."""
        builder = self.builder
        offset = builder.mul(builder.zext(index, I64), I64(stride))
        pointer = builder.inttoptr(builder.add(address, offset), ir.PointerType())
        return builder.load(pointer, typ=kind, align=1)

    def bits(self, words: Any, shift: Any, mask: int) -> Any:
        """Return (words >> shift) & mask as floats."""
        builder, count = self.builder, words.type.count
        shifted = builder.lshr(words, self.of([shift] * count))
        masked = builder.and_(shifted, self.constant([mask] * count, I32))
        return builder.sitofp(masked, ir.VectorType(F32, count))

    def total(self, vector: Any) -> Any:
        """Return the sum of a vector's lanes."""
        count = vector.type.count
        while count > 1:
            count //= 2
            low = self.pick(vector, vector, list(range(count)))
            high = self.pick(vector, vector, list(range(count, 2 * count)))
            vector = self.add(low, high)
        return self.builder.extract_element(vector, I32(0))


@intrinsic
def _filter_texels(typingctx, texels, start, size, shift, step, taps, share, fraction):
    """Return red, green and blue of a texture over a footprint, as in `sample_texture`.

    Args:
        texels: address of all texels (uint32, three 10-bit roots).
        start: (2,) first texel of both mip levels.
        size: (4,) width and height of both levels [px].
        shift: (2,) u and v of the first tap.
        step: (2,) change of u and v per tap.
        share: factor of the sum of squared roots.
        fraction: weight of the second level.
    """

    def generate(context, builder, signature_, arguments):
        address, start_, size_, shift_, step_, taps_, share_, fraction_ = arguments
        v = _Vectors(builder)
        starts = [builder.extract_value(start_, k) for k in range(2)]
        sizes = [builder.extract_value(size_, k) for k in range(4)]
        size4 = v.of(sizes)
        size4f = builder.sitofp(size4, ir.VectorType(F32, 4))
        rows = [builder.add(sizes[k], I32(1)) for k in (0, 2)]
        near = v.mul(v.sub(F32(1.0), fraction_), share_)
        far = v.mul(fraction_, share_)
        level8 = v.of([near] * 4 + [far] * 4)
        coordinate = cgutils.alloca_once(builder, ir.VectorType(F32, 4))
        builder.store(v.of([builder.extract_value(shift_, k % 2) for k in range(4)]), coordinate)
        step4 = v.of([builder.extract_value(step_, k % 2) for k in range(4)])
        sums = [cgutils.alloca_once(builder, ir.VectorType(F32, CORNERS)) for _ in range(3)]
        for one in sums:
            builder.store(v.constant([0.0] * CORNERS), one)
        zero4 = v.constant([0, 0, 0, 0], I32)
        with cgutils.for_range(builder, taps_):
            at = builder.load(coordinate, typ=step4.type)
            part = v.sub(at, v.floor(at))
            # v points up, rows go down.
            part = v.add(v.mul(part, v.constant([1.0, -1.0] * 2)), v.constant([0.0, 1.0] * 2))
            px = v.sub(v.mul(part, size4f), v.constant([0.5] * 4))
            whole = v.floor(px)
            f = v.sub(px, whole)
            g = v.sub(v.constant([1.0] * 4), f)
            low = builder.fptosi(whole, ir.VectorType(I32, 4))
            before = builder.icmp_signed("<", low, zero4)
            low = builder.select(before, builder.add(low, size4), low)
            pairs = []
            for level, (first, row) in enumerate(zip(starts, rows, strict=True)):
                x, y = (builder.extract_element(low, I32(2 * level + k)) for k in range(2))
                upper = builder.add(builder.add(first, x), builder.mul(y, row))
                pairs += [upper, builder.add(upper, row)]
            pairs = [v.load(address, pair, I64, 4) for pair in pairs]
            words = builder.bitcast(v.of(pairs), ir.VectorType(I32, CORNERS))
            weight = v.mul(v.pick(g, f, _X_OF_LEVELS), v.pick(g, f, _Y_OF_LEVELS))
            weight = v.mul(weight, level8)
            for channel, total in enumerate(sums):
                root = v.bits(words, I32(10 * channel), 1023)
                before_ = builder.load(total, typ=root.type)
                builder.store(v.add(v.mul(v.mul(weight, root), root), before_), total)
            builder.store(v.add(at, step4), coordinate)
        colors = [v.total(builder.load(one, typ=ir.VectorType(F32, CORNERS))) for one in sums]
        return context.make_tuple(builder, signature_.return_type, colors)

    pair, color = types.UniTuple(types.float32, 2), types.UniTuple(types.float32, 3)
    signature_ = color(
        types.uintp, types.UniTuple(types.int32, 2), types.UniTuple(types.int32, 4),
        pair, pair, types.int32, types.float32, types.float32,
    )  # fmt: skip
    return signature_, generate


@intrinsic
def _blend_cells(typingctx, cells, first, part, normal):
    """Return the sum of a grid's values around a point, as in `cube_at`.

    Args:
        cells: address of the cells, each of eight uint16: +x, −x, +y, −y, +z, −z, 0, 0.
        first: (4,) cells of the corners with the lower x: lower y and z, upper y, upper z, both.
        part: (3,) position between the corners.
        normal: (3,) unit normal.
    """

    def generate(context, builder, signature_, arguments):
        address, *rest = arguments
        v = _Vectors(builder)
        (x, y, z), axes = ([builder.extract_value(one, k) for k in range(3)] for one in rest[1:])
        one = F32(1.0)
        sides = [[v.sub(one, y), y], [v.sub(one, z), z]]
        pairs_type = ir.VectorType(ir.IntType(16), 2 * CORNERS)
        total = None
        for corner in range(4):
            cell = builder.extract_value(rest[0], corner)
            pair = v.load(address, cell, pairs_type, 2 * CORNERS)
            pair = builder.uitofp(pair, ir.VectorType(F32, 2 * CORNERS))
            weight = v.mul(sides[0][corner & 1], sides[1][corner >> 1])
            pair = v.mul(pair, v.of([weight] * (2 * CORNERS)))
            total = pair if total is None else v.add(total, pair)
        low, high = (v.pick(total, total, [*range(k, k + CORNERS)]) for k in (0, CORNERS))
        mean = v.add(v.mul(low, v.of([v.sub(one, x)] * 8)), v.mul(high, v.of([x] * 8)))
        zero, squares = F32(0.0), []
        for axis in axes:
            square = v.mul(axis, axis)
            positive = builder.fcmp_ordered(">=", axis, zero)
            squares += [builder.select(positive, square, zero)]
            squares += [builder.select(positive, zero, square)]
        return v.total(v.mul(mean, v.of([*squares, zero, zero])))

    cell, real = types.UniTuple(types.int32, 4), types.UniTuple(types.float32, 3)
    return types.float32(types.uintp, cell, real, real), generate


@intrinsic
def _prefetch(typingctx, address):
    """Bring the cache line at an address nearer."""

    def generate(context, builder, signature_, arguments):
        kind = ir.FunctionType(ir.VoidType(), [ir.PointerType(), I32, I32, I32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        pointer = builder.inttoptr(arguments[0], ir.PointerType())
        builder.call(function, [pointer, I32(0), I32(3), I32(1)])
        return context.get_dummy_value()

    return types.void(types.uintp), generate


prefetch: Any = _prefetch
filter_texels: Any = _filter_texels
blend_cells: Any = _blend_cells
