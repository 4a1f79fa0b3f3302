"""How kernels are compiled: once, into numba's cache, without what nobody calls.

Which, and when:

- A kernel with a signature is compiled, or loaded, when its module is imported. It has one where what is seen decides
  whether it is called, so that no frame waits for it; then another type is an error, not a second version.
- A kernel without one is compiled for what it is first called with, which a stage's warm-up does before the stage goes
  on line (a test holds it to that): so are those that every frame needs, and all that are given a NamedTuple, as arrays
  that belong together are; signatures cannot name these. The source's kernels wait for its first frame.
- A module of kernels is imported where it is used, as others are; inside a function only where the caller may never
  need it: segments that are switched off, boxes that are only shown, a recording that is no scene. Numba takes a second
  to import.

A kernel has at most eight parameters.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit
from numba.extending import register_jitable

_DIVISION = {"error_model": "numpy"}
"""One for all: what kernels of two models call, such as `np.zeros`, is compiled twice."""

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(signature: str | None = None, **options: Any) -> Callable[[Function], Function]:
    """Decorates a kernel: compiled for `signature` when its module is loaded, or for what it is first called with.

    It is kept in numba's cache and runs without the interpreter's lock; what is divided by zero is infinite or no
    number, as in NumPy. A second entry for C code, which numba adds by default, would take a fifth of the time to
    compile.

    A kernel is given the arrays that it writes: making or copying one inside takes 0.05 to 0.3 s to compile. Not where
    its loop runs over several values at once only because memory of its own cannot overlap with what it is given.
    """
    options = {"cache": True, "nogil": True, "no_cfunc_wrapper": True, **_DIVISION, **options}
    if signature is not None:
        return cast(Callable[[Function], Function], njit(signature, **options))

    def compiled_when_called(function: Function) -> Function:
        compiled = njit(**options)(function)
        if options["cache"]:
            _forget_what_cannot_be_read(compiled._cache)
        return cast(Function, compiled)

    return compiled_when_called


def _forget_what_cannot_be_read(cache: Any) -> None:
    """Empty a kernel's cache where it names a NamedTuple that another version of its module had.

    numba reads the names of all types before it looks whether the module has changed, and raises.
    """
    load = cache.load_overload

    def load_or_forget(*arguments: Any) -> Any:
        try:
            return load(*arguments)
        except (AttributeError, ImportError):
            cache.flush()
            return None

    cache.load_overload = load_or_forget


def part(**options: Any) -> Callable[[Function], Function]:
    """Decorates a function that kernels call, and nobody else: it is compiled into each of them.

    Called from Python it runs as Python. An entry from there, for arguments that are tuples of arrays, would take
    more time to compile than the function.
    """
    options = {"forceinline": True, "no_cfunc_wrapper": True, **_DIVISION, **options}
    return cast(Callable[[Function], Function], register_jitable(**options))
