"""Compiled functions: their decorator, and the signatures of the right-hand sides.

A kernel sees the phase ``phi = 2 pi tau / T`` instead of the time tau, so that one loop integrates any period
over the unit interval.  It owns no memory: constants, integer layout and scratch space are handed in.

RATES      ``out = f(phase, state, parameters)``; arguments ``phase, state, parameters, constants, layout,
           work, out``
TANGENT    ``out = J(phase, state, parameters) @ block``; ``block`` and ``out`` have shape (size, columns) in
           row-major order; arguments ``phase, state, block, parameters, constants, layout, work, out``

An implicit stepper also needs to solve the linear systems (I - shift J) x = b:

FACTORISE  fills ``factors`` (zeros before the first call) at a state; arguments ``phase, state, parameters,
           shift, constants, layout, work, factors``
SOLVE      replaces b by x in ``lanes``, a flat array with LANES columns row by row; arguments ``factors,
           constants, layout, work, lanes``

Decorate with ``@kernel(RATES)``: the explicit signature makes the compilation eager and gives the function
one address.  A compiled loop takes the functions that it calls as addresses of the type ENTRY, and is then
cached as well:

    loop(entry_point(system.rates, RATES), ...)         # in Python
    rates = as_rates(rates)                             # in the loop

Numba would accept the functions themselves, but looks up their addresses anew in every call, 0.1 ms each.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, is_jitted, overload, register_jitable

from .lanes import PLAIN

_VECTOR = types.float64[::1]
_MATRIX = types.float64[:, ::1]
_LAYOUT = types.int64[::1]

RATES = types.void(types.float64, _VECTOR, _VECTOR, _VECTOR, _LAYOUT, _VECTOR, _VECTOR)
TANGENT = types.void(types.float64, _VECTOR, _MATRIX, _VECTOR, _VECTOR, _LAYOUT, _VECTOR, _MATRIX)
FACTORISE = types.void(types.float64, _VECTOR, _VECTOR, types.float64, _VECTOR, _LAYOUT, _VECTOR, _VECTOR)
SOLVE = types.void(_VECTOR, _VECTOR, _LAYOUT, _VECTOR, _VECTOR)
ENTRY = types.intp

_PACKAGES = tuple(Path(__file__).parents[1] / name for name in ("machine", "orbits"))


def kernel(signature: Any = None, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """``numba.njit`` with a cache on the disk that becomes invalid when the sources of any kernel change.

    Numba looks at the file of a compiled function, not at the files of the functions that it calls: after an
    update of the sources it would silently run old machine code.

    ``signature``: compile at once for these types; None compiles at the first call.
    ``options``: options of ``njit``.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        compiled = njit(cache=True, **options)(function)
        cached = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
        if cached is not None and hasattr(cached, "_source_stamp") and hasattr(cached, "_version"):
            # These are internals of numba; without them its own rule holds.  The version is compared before
            # the rest is read, which would fail where types of arguments, such as named tuples, are gone.
            cached._source_stamp = source_digest()
            cached._version = f"{cached._version} {source_digest()}"
        if signature is not None and hasattr(compiled, "compile"):  # a plain function with NUMBA_DISABLE_JIT
            compiled.compile(signature)
            compiled.disable_compile()
        return compiled

    return decorate


@cache
def source_digest() -> str:
    """A hash of all files with kernels or their constants, and of the choice between the two ``lanes``."""
    digest = hashlib.sha256(b"plain" if PLAIN else b"vector")
    for path in sorted(path for package in _PACKAGES for path in package.rglob("*.py")):
        content = path.read_bytes()
        if b"kernel" in content or b"numba" in content:
            digest.update(content)
    return digest.hexdigest()


def entry_point(function: Callable[..., None], signature: Any) -> Any:
    """The address of a compiled function's machine code; a function of Python stands for itself.

    Valid in this process, as long as ``function`` lives. Raises numba's TypingError for a compiled function
    of another signature.
    """
    return _address(function, signature) if is_jitted(function) else function


@lru_cache(256)
def _address(function: Any, signature: Any) -> int:
    compiled = function.get_compile_result(signature)
    address: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    return address


_operation: Any = intrinsic  # numba's annotation counts the typing context among the arguments of a call


def _function_at(signature: Any) -> Callable[..., Any]:
    """A function that makes an address a first-class function of this signature, in compiled loops."""
    kind = types.FunctionType(signature)

    @_operation
    def convert(typing, entry):  # type: ignore[no-untyped-def]
        def generate(context, builder, _, arguments):  # type: ignore[no-untyped-def]
            function = cgutils.create_struct_proxy(kind)(context, builder)
            function.jit_addr = builder.inttoptr(arguments[0], cgutils.voidptr_t)
            function.c_addr = function.py_addr = cgutils.voidptr_t(None)
            return function._getvalue()

        return kind(ENTRY), generate

    def at(entry: Any) -> Any:
        return entry

    @overload(at)  # type: ignore[untyped-decorator]
    def _(entry):  # type: ignore[no-untyped-def]
        return lambda entry: convert(entry)

    return at


as_rates, as_tangent, as_factorise, as_solve = map(_function_at, (RATES, TANGENT, FACTORISE, SOLVE))


@register_jitable  # type: ignore[untyped-decorator]
def assign(out: Any, values: Any) -> None:
    """out[:] = values, for vectors of equal length.

    Numba's own assignment compiles the message of its error too, for a tenth of a second in every kernel.
    """
    for i in range(out.shape[0]):
        out[i] = values[i]
