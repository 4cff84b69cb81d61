"""How device code reads and writes memory, and how its loops become vector code on a CPU.

Arrays are flat and scalar (Warp's loops over arrays of vectors do not vectorise); `space` loads
vectors from them. Bonds and elements meet in a padded table, slot after slot: an element's slot
holds an entry 2 * bond + side, side 0 for the bond's first element, or the row of zeros after the
last bond. What a bond does to an element it writes into the element's slot (its place), so that an
element's sum runs over contiguous memory, in a fixed order.
"""

from functools import cache
from typing import Any

import warp as wp

from ..cache import sealed

wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)  # no line for every kernel loaded


_INDEX = """
#if !defined(__CUDA_ARCH__)
    __builtin_assume(i >= 0);
#endif
"""
_LOAD, _STORE = _INDEX + "return a.data[i];", _INDEX + "a.data[i] = value;"


@wp.func_native(_INDEX + "return i;")
def nn(i: int) -> int: ...  # an index known not to be negative: turns gathers into plain loads


# Entry i of an array, i not negative. Warp's own a[i] multiplies by a stride that it does not know
# to be that of a whole array, for each lane of a vector loop.
@wp.func_native(_LOAD)
def get(a: wp.array(dtype=wp.float32), i: int) -> wp.float32: ...


@wp.func_native(_LOAD)
def get(a: wp.array(dtype=wp.float64), i: int) -> wp.float64: ...  # noqa: F811


@wp.func_native(_LOAD)
def get(a: wp.array(dtype=wp.int32), i: int) -> wp.int32: ...  # noqa: F811


@wp.func_native(_STORE)
def put(a: wp.array(dtype=Any), i: int, value: Any): ...  # a[i] = value


# indices that a vector loop runs over at a time, and threads take several of: compilers may run the
# last ones of a loop as plain code, whose last bits differ, so loops end where they always do
CHUNK = 512
_LOOP = "    for (size_t task_index = 0; task_index < dim->size; ++task_index)"
# shape and size of a launch over one dimension agree; in a thread's share of it they do not
_PATCH = """    size_t task_first = 0;
#ifdef WARPDEM
    if ({launch_ndim} == 1 && dim->shape[0] > dim->size) task_first = dim->shape[0] - dim->size;
#endif
    const size_t task_end = dim->size;
#ifdef WARPDEM_SIMD
    for (size_t chunk = task_first; chunk < task_end; chunk += WARPDEM_SIMD)
    _Pragma("clang loop vectorize(assume_safety) interleave(disable)")
    for (size_t task_index = chunk;
         task_index < (chunk + WARPDEM_SIMD < task_end ? chunk + WARPDEM_SIMD : task_end);
         ++task_index)
#else
    for (size_t task_index = task_first; task_index < task_end; ++task_index)
#endif"""


@cache
def is_patched() -> bool:
    """Whether CPU loops can be vectorised and shared out: not where this Warp's code is unknown.

    Warp runs a CPU kernel as one scalar loop. Two changes to its code template, active only in
    kernels compiled with the flags below, let the loop begin at a thread's share, and state that
    iterations are independent. That holds for kernels that write at their own index, into their own
    bond's slots, or one constant into a flag; one with an atomic would silently lose updates. What
    such a loop writes should be of real numbers, flags too: integers written could be the numbers
    that it counts by, for all the compiler knows, and it then loads and stores them all anew.
    """
    import warp._src.codegen as codegen

    template = getattr(codegen, "cpu_module_template_forward", "")
    if template.count(_LOOP) != 1:
        return False
    codegen.cpu_module_template_forward = template.replace(_LOOP, _PATCH)
    return True


def compiler_flags(simd: bool) -> str | None:
    """Compiler flags of kernels on a CPU, or None where Warp is not known."""
    if not is_patched():
        return None
    flags = (wp.config.cpu_compiler_flags or "") + " -DWARPDEM=1"
    if simd:
        flags += " -ffp-contract=fast -fno-signed-zeros -mprefer-vector-width=512"
        flags += f" -Wno-pass-failed -DWARPDEM_SIMD={CHUNK}"
    return flags


def is_shareable(kernel: wp.Kernel) -> bool:
    """Whether threads can take shares of a launch of this kernel."""
    return "-DWARPDEM=1" in (kernel.module.options.get("cpu_compiler_flags") or "")


# A thread that waits looks often at first, then lets others have its core: give_way is the address
# of the system's function for that, as Warp's compiler knows of none.
_LOOK = """
#if defined(__x86_64__)
        __builtin_ia32_pause();
#endif
        if (look > 2000 && give_way) ((void (*)())give_way)();
"""


@wp.func_native(
    """
#if !defined(__CUDA_ARCH__)
    unsigned long long* arrived = (unsigned long long*)counters.data;
    unsigned long long n = __atomic_fetch_add(arrived, 1ull, __ATOMIC_ACQ_REL);
    unsigned long long all = (n / threads + 1ull) * threads;
    for (long long look = 0; __atomic_load_n(arrived, __ATOMIC_ACQUIRE) < all; ++look) {"""
    + _LOOK
    + """    }
#endif
"""
)
def meet(counters: wp.array(dtype=wp.uint64), threads: wp.uint64, give_way: wp.uint64): ...


@wp.func_native(
    """
#if !defined(__CUDA_ARCH__)
    unsigned long long* count = (unsigned long long*)counters.data + 8;
    for (int look = 0; look < patience; ++look) {
        if (__atomic_load_n(count, __ATOMIC_ACQUIRE) > begun) return;"""
    + _LOOK
    + """    }
#endif
"""
)
def wait(
    counters: wp.array(dtype=wp.uint64), begun: wp.uint64, patience: int, give_way: wp.uint64
): ...


@sealed
@wp.kernel(module="unique", enable_backward=False)
def rendezvous(counters: wp.array(dtype=wp.uint64), threads: wp.uint64, give_way: wp.uint64):
    """Returns when as many threads have called it."""
    meet(counters, threads, give_way)


@sealed
@wp.kernel(module="unique", enable_backward=False)
def wait_for(
    counters: wp.array(dtype=wp.uint64), begun: wp.uint64, patience: int, give_way: wp.uint64
):
    """Returns when more than `begun` graphs have begun, or after so many looks."""
    wait(counters, begun, patience, give_way)


def kernel(function, simd: bool = True):
    """A kernel of its own module; `simd` vectorises it if this Warp allows it."""
    flags = compiler_flags(simd)
    options = {} if flags is None else {"cpu_compiler_flags": flags}
    made = wp.kernel(function, module="unique", enable_backward=False, module_options=options)
    return sealed(made)
