"""What numba alone does not turn into vector code: minima, single bits, and moves of one box."""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from grasptransfer.registration.blocks import BLOCK


@intrinsic
def bits_of_float(typing_context, number):
    """The bits of a float32."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(types.int32))

    return types.int32(types.float32), generate


@intrinsic
def float_of_bits(typing_context, bits):
    """The float32 with these bits."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(types.float32))

    return types.float32(types.int32), generate


@intrinsic
def smaller(typing_context, a, b):
    """The smaller of two float32 that are not NaN; loops over `min` do not become vector code."""

    def generate(context, builder, signature, arguments):
        kind = arguments[0].type
        minimum = builder.module.declare_intrinsic("llvm.minnum", [kind], ir.FunctionType(kind, [kind] * 2))
        return builder.call(minimum, arguments, fastmath=("nnan", "nsz"))

    return types.float32(types.float32, types.float32), generate


def _box(context, builder, kind, array, start):
    """Pointer to BLOCK numbers of a float32 array."""
    first = builder.gep(make_array(kind)(context, builder, array).data, [start])
    return builder.bitcast(first, ir.VectorType(ir.FloatType(), BLOCK).as_pointer())


def _two_boxes(work):
    """Do `work(builder, there, here)` on two boxes; a loop over one would go number by number."""

    def declare(typing_context, target, start, source, origin):
        def generate(context, builder, signature, arguments):
            there = _box(context, builder, signature.args[0], *arguments[:2])
            here = _box(context, builder, signature.args[2], *arguments[2:])
            work(builder, there, here)
            return context.get_dummy_value()

        return types.void(target, types.int64, source, types.int64), generate

    return declare


@intrinsic
def copy_box(typing_context, target, start, source, origin):
    """target[start : start + BLOCK] = source[origin : origin + BLOCK], as one move."""

    def copy(builder, there, here):
        builder.store(builder.load(here, align=4), there, align=4)

    return _two_boxes(copy)(typing_context, target, start, source, origin)


@intrinsic
def add_box(typing_context, target, start, source, origin):
    """target[start : start + BLOCK] += source[origin : origin + BLOCK], as one move."""

    def add(builder, there, here):
        total = builder.fadd(builder.load(there, align=4), builder.load(here, align=4))
        builder.store(total, there, align=4)

    return _two_boxes(add)(typing_context, target, start, source, origin)
