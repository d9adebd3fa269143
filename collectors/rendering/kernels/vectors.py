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

    def gather(self, address: Any, words: Any) -> Any:
        """Return the 32-bit words (8) with the given numbers after an address."""
        builder = self.builder
        wide = builder.zext(words, ir.VectorType(I64, CORNERS))
        bytes_ = builder.mul(wide, self.constant([4] * CORNERS, I64))
        pointers_type = ir.VectorType(ir.PointerType(), CORNERS)
        pointers = builder.inttoptr(
            builder.add(self.of([address] * CORNERS), bytes_), pointers_type
        )
        word_type, mask_type = ir.VectorType(I32, CORNERS), ir.VectorType(ir.IntType(1), CORNERS)
        kind = ir.FunctionType(word_type, [pointers_type, I32, mask_type, word_type])
        name = "llvm.masked.gather.v8i32.v8p0"
        function = cgutils.get_or_insert_function(builder.module, kind, name)
        all_lanes = ir.Constant(mask_type, [1] * CORNERS)
        return builder.call(
            function, [pointers, I32(4), all_lanes, ir.Constant(word_type, ir.Undefined)]
        )

    def bits(self, words: Any, shift: Any, mask: int) -> Any:
        """Return (words >> shift) & mask as floats."""
        builder, count = self.builder, words.type.count
        shifted = builder.lshr(words, self.of([shift] * count))
        kept = builder.and_(shifted, self.constant([mask] * count, I32))
        return builder.sitofp(kept, ir.VectorType(F32, count))

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
        offset8 = v.of([starts[0]] * 4 + [starts[1]] * 4)
        width8 = v.of([sizes[0]] * 4 + [sizes[2]] * 4)
        near = v.mul(v.sub(F32(1.0), fraction_), share_)
        far = v.mul(fraction_, share_)
        level8 = v.of([near] * 4 + [far] * 4)
        coordinate = cgutils.alloca_once(builder, ir.VectorType(F32, 4))
        builder.store(v.of([builder.extract_value(shift_, k % 2) for k in range(4)]), coordinate)
        step4 = v.of([builder.extract_value(step_, k % 2) for k in range(4)])
        sums = [cgutils.alloca_once(builder, ir.VectorType(F32, CORNERS)) for _ in range(3)]
        for one in sums:
            builder.store(v.constant([0.0] * CORNERS), one)
        one4, zero4 = v.constant([1, 1, 1, 1], I32), v.constant([0, 0, 0, 0], I32)
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
            high = builder.add(low, one4)
            before = builder.icmp_signed("<", low, zero4)
            low = builder.select(before, builder.add(low, size4), low)
            beyond = builder.icmp_signed(">=", high, size4)
            high = builder.select(beyond, builder.sub(high, size4), high)
            rows = builder.mul(v.pick(low, high, _Y_OF_LEVELS), width8)
            columns = v.pick(low, high, _X_OF_LEVELS)
            words = v.gather(address, builder.add(builder.add(offset8, rows), columns))
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
def _blend_cells(typingctx, cells, low, high, part, normal):
    """Return the sum of a grid's values around a point, as in `cube_at`.

    Args:
        cells: address of the cells, each of six uint16: +x, −x, +y, −y, +z, −z.
        low: (3,) first cell of the corners with x, y, z at the lower side: x, y · columns,
            z · columns · rows.
        high: (3,) the same at the upper side.
        part: (3,) position between them.
        normal: (3,) unit normal.
    """

    def generate(context, builder, signature_, arguments):
        address, *rest = arguments
        low_, high_, part_, normal_ = (
            [builder.extract_value(one, k) for k in range(3)] for one in rest
        )
        v = _Vectors(builder)
        cell, weight = None, None
        for axis in range(3):
            upper = [bool(corner >> axis & 1) for corner in range(CORNERS)]
            side = v.of([(high_ if up else low_)[axis] for up in upper])
            rest_ = v.sub(F32(1.0), part_[axis])
            share = v.of([part_[axis] if up else rest_ for up in upper])
            cell = side if cell is None else builder.add(cell, side)
            weight = share if weight is None else v.mul(weight, share)
        word = builder.mul(cell, v.constant([3] * CORNERS, I32))
        mean = None
        for axis in range(3):
            # The two directions of an axis are the halves of one word.
            positive = builder.fcmp_ordered(">=", normal_[axis], F32(0.0))
            half = builder.select(positive, I32(0), I32(16))
            words = v.gather(address, builder.add(word, v.constant([axis] * CORNERS, I32)))
            square = v.mul(normal_[axis], normal_[axis])
            one = v.mul(v.bits(words, half, 0xFFFF), v.of([square] * CORNERS))
            mean = one if mean is None else v.add(mean, one)
        return v.total(v.mul(mean, weight))

    cell, real = types.UniTuple(types.int32, 3), types.UniTuple(types.float32, 3)
    return types.float32(types.uintp, cell, cell, real, real), generate


filter_texels: Any = _filter_texels
blend_cells: Any = _blend_cells
