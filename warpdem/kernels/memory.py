"""How device code reads and writes memory, and how its loops become vector code on a CPU.

Arrays are flat and scalar (Warp's loops over arrays of vectors do not vectorise); `space` loads
vectors from them. Bonds and elements meet in a padded incidence table, slot after slot: an entry is
2 * bond + side, side 0 for the bond's first element, and a missing bond points at a row of zeros.
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
    write at their own index only; one with an atomic would silently lose updates.
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


@cache
def index(is_listed: bool):
    """Index of the t-th element or bond: t itself, or the t-th of a list."""
    if is_listed:

        @wp.func
        def looked_up(listed: wp.array(dtype=int), t: int) -> int:
            return nn(listed[nn(t)])

        return looked_up

    @wp.func
    def own(listed: wp.array(dtype=int), t: int) -> int:
        return nn(t)

    return own


def kernel(function, simd: bool = True):
    """A kernel of its own module; `simd` vectorises it if this Warp allows it."""
    flags = simd_flags() if simd else None
    options = {} if flags is None else {"cpu_compiler_flags": flags}
    return wp.kernel(function, module="unique", enable_backward=False, module_options=options)
