"""Measured peak of the processor: independent vector operations in registers and nothing else.

`numba` has no notation for a vector register, so that an intrinsic writes the loop in LLVM's language: `CHAINS`
accumulators, each of which a pass replaces by one operation on itself. There are more chains than the product of
latency and throughput, so that no arithmetic unit waits.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

CHAINS = 12
PASSES = 200_000
WIDTHS = (2, 4, 8)  # float64 in a register: SSE2 or NEON, AVX2, AVX-512
OPERATIONS = ("fma", "sqrt", "division")
DOUBLE, INDEX = ir.DoubleType(), ir.IntType(32)


def loop(operation: str, width: int) -> Callable[[int, float], float]:
    """Compiled function of the number of passes and a start value; its result keeps all accumulators in use."""
    vector = ir.VectorType(DOUBLE, width)

    def filled(builder: Any, scalar: Any) -> Any:
        out = ir.Constant(vector, ir.Undefined)
        for k in range(width):
            out = builder.insert_element(out, scalar, ir.Constant(INDEX, k))
        return out

    def changed(builder: Any, chain: Any, factor: Any, constant: Any) -> Any:
        if operation == "division":
            return builder.fdiv(constant, chain)
        given = (chain, factor, constant) if operation == "fma" else (chain,)
        kind = ir.FunctionType(vector, [vector] * len(given))
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{operation}.v{width}f64")
        return builder.call(function, given)

    @intrinsic
    def repeated(typing_context, passes, start):
        def generate(context, builder, signature, arguments):
            count, value = arguments
            constant, factor = filled(builder, value), filled(builder, ir.Constant(DOUBLE, 0.999))
            # accumulators that start alike would be one to the compiler
            first = [filled(builder, builder.fadd(value, ir.Constant(DOUBLE, 0.01 * k))) for k in range(CHAINS)]
            entry = builder.block
            head, body, end = (builder.append_basic_block(name) for name in ("head", "body", "end"))
            builder.branch(head)
            builder.position_at_end(head)
            index = builder.phi(count.type)
            chains = [builder.phi(vector) for _ in range(CHAINS)]
            builder.cbranch(builder.icmp_signed("<", index, count), body, end)
            builder.position_at_end(body)
            after = [changed(builder, chain, factor, constant) for chain in chains]
            following = builder.add(index, ir.Constant(count.type, 1))
            builder.branch(head)
            index.add_incoming(ir.Constant(count.type, 0), entry)
            index.add_incoming(following, body)
            for chain, before, new in zip(chains, first, after, strict=True):
                chain.add_incoming(before, entry)
                chain.add_incoming(new, body)
            builder.position_at_end(end)
            total = ir.Constant(DOUBLE, 0.0)
            for chain in chains:
                for k in range(width):
                    total = builder.fadd(total, builder.extract_element(chain, ir.Constant(INDEX, k)))
            return total

        return types.float64(types.int64, types.float64), generate

    @njit
    def run(passes, start):
        return repeated(passes, start)

    return run


@cache
def loops() -> dict[tuple[str, int], Callable[[int, float], float]]:
    """Compiled loops by operation and width."""
    out = {(operation, width): loop(operation, width) for operation in OPERATIONS for width in WIDTHS}
    for function in out.values():
        function(1, 1.0)
    return out


def rates(rounds: int = 5) -> dict[str, float]:
    """Operations on one float64 per second, the most of all widths and rounds, by operation; an FMA counts once."""
    most = dict.fromkeys(OPERATIONS, 0.0)
    for _ in range(rounds):
        for (operation, width), function in loops().items():
            passes = PASSES if operation == "fma" else PASSES // 8
            begin = time.process_time()
            function(passes, 1.5)
            rate = passes * CHAINS * width / (time.process_time() - begin)
            most[operation] = max(most[operation], rate)
    return most
