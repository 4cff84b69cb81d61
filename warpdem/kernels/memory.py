"""How device code reads and writes memory, and how its loops become vector code on a CPU.

Arrays are flat and scalar (Warp's loops over arrays of vectors do not vectorise); `space` loads
vectors from them. Bonds and elements meet in a padded table, slot after slot: an element's slot
holds an entry 2 * bond + side, side 0 for the bond's first element, or the row of zeros after the
last bond. What a bond does to an element it writes into the element's slot (its place), so that an
element's sum runs over contiguous memory, in a fixed order.
"""

from functools import cache

import warp as wp

wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)  # no line for every kernel loaded


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return i;
#else
    __builtin_assume(i >= 0); return i;
#endif
""")
def nn(i: int) -> int: ...  # an index known not to be negative: turns gathers into plain loads


_LOOP = "    for (size_t task_index = 0; task_index < dim->size; ++task_index)"
_PRAGMA = """#ifdef WARPDEM_SIMD
    _Pragma("clang loop vectorize(assume_safety) interleave(disable)")
#endif
"""


@cache
def simd_flags() -> str | None:
    """Compiler flags that vectorise a kernel's loop on a CPU, or None where Warp is not known.

    Warp runs a CPU kernel as one scalar loop. A pragma in its code template, active only in kernels
    compiled with these flags, states that iterations are independent. That holds for kernels that
    write at their own index, into their own bond's slots, or one constant into a flag; one with an
    atomic would silently lose updates.
    """
    import warp._src.codegen as codegen

    template = getattr(codegen, "cpu_module_template_forward", "")
    if template.count(_LOOP) != 1:
        return None
    codegen.cpu_module_template_forward = template.replace(_LOOP, _PRAGMA + _LOOP)
    return (
        (wp.config.cpu_compiler_flags or "")
        + " -ffp-contract=fast -fno-signed-zeros -mprefer-vector-width=512 -Wno-pass-failed"
        + " -DWARPDEM_SIMD=1"
    )


def kernel(function, simd: bool = True):
    """A kernel of its own module; `simd` vectorises it if this Warp allows it."""
    flags = simd_flags() if simd else None
    options = {} if flags is None else {"cpu_compiler_flags": flags}
    return wp.kernel(function, module="unique", enable_backward=False, module_options=options)
