"""How kernels are compiled: once, into numba's cache, without unused entry points.

Which, and when:

- A kernel with a signature is compiled, or loaded, when its module is imported. It has one if the scene decides whether
  it is called, so that no frame waits for it. Another argument type is then an error, not a second version.
- A kernel without a signature is compiled for the arguments of its first call, which a stage's warm-up makes before the
  stage goes on line (a test holds it to that). These are the kernels that every frame needs, and all that take a
  NamedTuple of arrays, which signatures cannot name. The source's kernels wait for its first frame.
- A module of kernels is imported at the top like others, and inside a function only if the caller may never need it:
  segments that are switched off, boxes that are only shown, a recording that is no scene. Importing numba takes a
  second.

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
    """Decorate a kernel: compile it for `signature` when its module is loaded, or for the arguments of its first call.

    It is kept in numba's cache and runs without the interpreter's lock. Division by zero gives infinity or NaN, as in
    NumPy. An entry point for C code, which numba adds by default, would take a fifth of the time to compile.

    Pass a kernel the arrays that it writes: making or copying one inside takes 0.05 to 0.3 s to compile. The exception
    is a kernel whose loop is vectorised only because its own memory cannot overlap with its arguments.
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
    """Empty a kernel's cache if it names a NamedTuple that only another version of its module had.

    numba resolves the names of all types before it checks whether the module has changed, and raises.
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
    """Decorate a function that only kernels call: it is compiled into each of them.

    Called from Python it runs as Python. A compiled entry point for arguments that are tuples of arrays would take more
    time to compile than the function.
    """
    options = {"forceinline": True, "no_cfunc_wrapper": True, **_DIVISION, **options}
    return cast(Callable[[Function], Function], register_jitable(**options))
