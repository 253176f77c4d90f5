"""Strapdown propagation of sigma points: share of the processor's measured peak, and against plain Python.

Run: ``python benchmarks/bench_propagation.py``
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from unittest.mock import patch

import numpy as np
import plain_filter
import vector_peak
from measuring import Grid, Row, Section, at_least, interleaved, run
from numba import njit

from edl_filter.navigation import strapdown
from edl_filter.rotation_kernels import product
from edl_filter.types import Array

MU, J2, RADIUS = 4.282837e13, 1.960454e-3, 3396190.0
POINTS, SAMPLES = 80, 4000  # about those of Spirit
VECTOR = re.compile(r"\s(v(?:fn?m(?:add|sub)\d*|add|sub|mul|div|sqrt)pd)\s")


@dataclass
class Counted:
    """Number that counts the operations on it."""

    value: float
    counts: Counter = field(repr=False, compare=False)

    def _of(self, operation: str, value: float) -> Counted:
        self.counts[operation] += 1
        return Counted(value, self.counts)

    def __add__(self, operand):
        return self._of("add", self.value + plain(operand))

    def __sub__(self, operand):
        return self._of("add", self.value - plain(operand))

    def __rsub__(self, operand):
        return self._of("add", plain(operand) - self.value)

    def __mul__(self, operand):
        return self._of("multiply", self.value * plain(operand))

    def __truediv__(self, operand):
        # by a constant: the compiler multiplies by its reciprocal
        return self._of("division" if isinstance(operand, Counted) else "multiply", self.value / plain(operand))

    def __rtruediv__(self, operand):
        return self._of("division", plain(operand) / self.value)

    def sqrt(self):
        return self._of("sqrt", self.value**0.5)

    __radd__, __rmul__ = __add__, __mul__


def plain(x: object) -> float:
    """Value of a number of either kind."""
    return x.value if isinstance(x, Counted) else float(x)  # type: ignore[arg-type]


def operations() -> Counter:
    """Operations of one sigma point and sample: `strapdown.step` on numbers that count, and the corrections by hand."""
    counts: Counter = Counter()
    state = [3.5e6, 2e5, -3e5, -200.0, 900.0, 300.0, 0.1, -0.3, 0.4, 0.86]
    counted = [Counted(x, counts) for x in state]
    force, rate = ([Counted(x, counts) for x in (a, 1.0, -3.0)] for a in (-25.0, 0.3))
    with patch.object(strapdown, "product", product.py_func):
        result = strapdown.step.py_func(*counted, 0.125, *force, *rate, -MU, 1.5 * J2 * RADIUS**2)
    # what depends on the sample alone is computed once for all sigma points; the step has no such product but 0.25 dt
    assert np.all(np.isfinite([plain(x) for x in result]))
    return counts + Counter({"multiply": 12, "add": 12})  # A f + c with 3 × 3 values, a ∘ w + c


def instructions() -> Counter:
    """Vector instructions of the compiled loop over a block, by kind; empty where the assembly has other names."""
    fresh = njit(fastmath=strapdown.FAST, error_model="numpy")(
        strapdown.propagate.py_func
    )  # a cached one has no assembly
    no_samples = np.empty(0), np.empty((0, 3)), np.empty((0, 3))
    fresh(
        np.ones((10, strapdown.LANES)),
        np.ones((12, strapdown.LANES)),
        np.ones((6, strapdown.LANES)),
        *no_samples,
        MU,
        J2,
        RADIUS,
    )
    blocks = re.split(r"^\.?L\w+:", next(iter(fresh.inspect_asm().values())), flags=re.MULTILINE)
    inner = next((text for text in blocks if "sqrtpd" in text), "")
    return Counter("fma" if "fm" in name or "fnm" in name else name[1:-2] for name in VECTOR.findall(inner))


def problem(points: int, samples: int) -> Callable[[], None]:
    """Propagation of `points` sigma points over `samples` samples."""
    rng = np.random.default_rng(0)
    state = np.zeros((10, points))
    state[0], state[4], state[9] = 3.5e6, 3000.0, 1.0
    force_map, rate_map = np.zeros((12, points)), np.zeros((6, points))
    force_map[[0, 4, 8]], rate_map[:3] = 1.0, 1.0
    interval = np.full(samples, 0.125)
    force, rate = 10.0 * rng.standard_normal((samples, 3)), 0.2 * rng.standard_normal((samples, 3))
    return lambda: strapdown.propagate(state.copy(), force_map, rate_map, interval, force, rate, MU, J2, RADIUS)


def python_twin(samples: int) -> tuple[Callable[[], Array], Callable[[], Array]]:
    """One state over samples by numpy step by step, and the same by the kernel."""
    from types import SimpleNamespace

    rng = np.random.default_rng(1)
    state = np.array([3.39e6, 2e5, -3e5, -200.0, 900.0, 300.0, 0.0, 0.0, 0.0, 1.0])
    interval = np.full(samples, 0.125)
    force, rate = 10.0 * rng.standard_normal((samples, 3)), 0.2 * rng.standard_normal((samples, 3))
    planet = SimpleNamespace(mu=MU, j2=J2, gravity_radius=RADIUS)
    columns = strapdown.LANES
    force_map, rate_map = np.zeros((12, columns)), np.zeros((6, columns))
    force_map[[0, 4, 8]], rate_map[:3] = 1.0, 1.0

    def python() -> Array:
        out = state
        for dt, f, w in zip(interval, force, rate, strict=True):
            out = plain_filter.step(out, dt, f, w, planet)
        return out

    def kernel() -> Array:
        out = np.repeat(state[:, None], columns, axis=1)
        strapdown.propagate(out, force_map, rate_map, interval, force, rate, MU, J2, RADIUS)
        return out[:, 0]

    return python, kernel


def share_of_peak() -> Section:
    """Floating-point operations a second of the kernel against the peak."""
    counts, kernel = operations(), problem(POINTS, SAMPLES)
    flops = sum(counts.values())
    code = instructions()
    rounds = [
        (vector_peak.rates(rounds=1), interleaved({"kernel": kernel}, rounds=1).least("kernel")) for _ in range(9)
    ]
    rates = {name: max(r[name] for r, _ in rounds) for name in vector_peak.OPERATIONS}
    shares = [100.0 * flops * POINTS * SAMPLES / spent / (2.0 * rates["fma"]) for _, spent in rounds]
    slots = sum(n for kind, n in code.items() if kind not in ("div", "sqrt"))
    slots += sum(code[kind] * rates["fma"] / rates[name] for kind, name in (("div", "division"), ("sqrt", "sqrt")))
    low, high = np.quantile(shares, [0.25, 0.75])
    listed = ", ".join(f"{n} {kind}" for kind, n in sorted(counts.items()))
    widths = ", ".join(str(w) for w in vector_peak.WIDTHS)
    division, root = (rates["fma"] / rates[name] for name in ("division", "sqrt"))
    text = f"""
One sigma point and sample takes {flops} floating-point operations ({listed}), counted by running
`strapdown.step` on numbers that count their operations. The peak is that of independent fused multiply-adds (FMA) in
vector registers, two operations each, the largest over registers of {widths} numbers. Of the compiled loop's arithmetic
instructions {share_of_fma(code):.0f} % are FMA. Each other instruction does one operation in the time in which the peak
counts two; a division and a square root take as long as {division:.0f} and {root:.0f} FMA. The second line is the share
that these instructions would reach one after the other, if none of them waited for another one or for memory. A
processor that divides while it multiplies can exceed it.
"""
    rows = [
        Row(
            "strapdown propagation, operations a second, %",
            "measured peak of FMA",
            max(shares),
            (low, high),
            at_least(60.0),
        ),
        Row(
            "the same instructions in turn, without waiting, %",
            "measured peak of FMA",
            100.0 * flops / (2.0 * max(slots, 1.0)),
        ),
    ]
    return Section("Propagation", text, rows)


def share_of_fma(code: Counter) -> float:
    """Per cent of instructions that are FMA."""
    return 100.0 * code["fma"] / max(sum(code.values()), 1)


def growth() -> Section:
    """Time a point and sample over both numbers."""
    points, samples = (16, 32, 48, 64, 80, 160), (8, 64, 512, 4096)
    functions = {f"{p} {n}": problem(p, n) for p in points for n in samples}
    times = interleaved(functions, rounds=5, shortest=0.005)
    unit = times.least("80 4096") / (80 * 4096)
    lines = {str(p): [times.least(f"{p} {n}") / (p * n) / unit for n in samples] for p in points}
    text = "Processor time of a sigma point and sample, relative to 80 points and 4096 samples."
    return Section(
        "Propagation: growth with points and samples",
        text,
        grid=Grid("points", [f"{n} samples" for n in samples], lines),
    )


def against_python() -> Section:
    """The kernel against numpy, one state at a time."""
    python, kernel = python_twin(400)
    difference = np.max(np.abs(python() - kernel())[6:])
    assert np.allclose(python(), kernel(), rtol=1e-10, atol=1e-6), difference
    times = interleaved({"python": python, "kernel": kernel}, rounds=5)
    row = times.row(
        "numpy, one state, step by step",
        "the kernel, for each sigma point",
        "python",
        "kernel",
        agreement="equal to 1e-10",
        factor=strapdown.LANES,
    )
    return Section("Propagation: against plain Python", "", [row])


def measure() -> list[Section]:
    """All sections."""
    return [share_of_peak(), growth(), against_python()]


if __name__ == "__main__":
    run(measure)
