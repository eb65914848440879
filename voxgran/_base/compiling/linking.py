"""How kernels are compiled that other kernels call.

numba optimizes each function and makes machine code of it, and does both again for its copy in every function that
calls it. A kernel that only kernels call needs neither: here its intermediate code is kept as it was lowered, and
optimized once, in the kernel that Python calls, which links the code of all that it calls directly or indirectly.
Literal arguments (an axis 0, 1 or 2) do not make specializations of a callee, since LLVM propagates constants anyway.

Machine code is made for x86-64-v3 (AVX2) where the processor has it, and not for that very processor: kernels that come
with the package then serve, and those that are compiled here give the same bits on other machines. It costs no time.

This file is loaded when a kernel is compiled, never before: it imports numba.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, ClassVar

from numba import config, types
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import Compiler, Flags
from numba.core.registry import CPUDispatcher
from numba.core.targetconfig import ConfigStack
from numba.core.typed_passes import NativeLowering
from numba.core.types.functions import BaseFunction

from voxgran._base.compiling.lowering import ValueLowering
from voxgran._base.lazy import preparing

#: the processor for which kernels are compiled, and what it has beyond what each x86-64 has, as LLVM names it
BASELINE = "x86-64-v3"
FEATURES = frozenset(
    ["+avx2", "+bmi", "+bmi2", "+cx16", "+f16c", "+fma", "+lzcnt", "+movbe", "+popcnt", "+sahf", "+xsave"]
)


class BaselineCodegen(JITCPUCodegen):
    """What makes machine code for the baseline."""

    def _get_host_cpu_name(self) -> str:
        """Return the processor for which code is made."""
        return BASELINE

    def _get_host_cpu_features(self) -> str:
        """Return what is added to that processor: nothing."""
        return ""


@cache
def codegen_of(context: Any) -> JITCPUCodegen:
    """Return what makes the machine code of kernels: numba's own where the processor lacks a part of the baseline, or
    where ``NUMBA_CPU_NAME`` names another.
    """
    own = context.codegen()
    features = frozenset(own.magic_tuple()[2].split(","))
    return BaselineCodegen("voxgran") if config.CPU_NAME is None and features >= FEATURES else own


class KernelFlags(Flags):
    """Options of the compiler that are compared quickly.

    numba looks up each operator under a key that holds all forty options, and comparing them one by one took a tenth
    of the time of a compilation.
    """

    _hash = hash(Flags())
    _defaults: ClassVar[dict[str, Any]] = {name: option.default for name, option in Flags.options.items()}

    def __hash__(self) -> int:
        """Return the hash of the names of all options, which is what numba computes each time."""
        return self._hash

    def __eq__(self, other: object) -> bool:
        """Return whether all options are equal."""
        if not isinstance(other, Flags):
            return NotImplemented
        mine, theirs = self._values, other._values
        return bool(mine == theirs or {**self._defaults, **mine} == {**self._defaults, **theirs})


@contextmanager
def signatures_kept() -> Iterator[None]:
    """Keep numba's signatures of calls while a kernel and its callees are compiled; other functions are not concerned.

    numba tries all definitions of an operator at each place where it stands, which took a sixth of a compilation. The
    lookup is replaced only while numba's lock of the compiler is held, and put back afterwards.
    """
    resolve = BaseFunction.get_call_type
    if getattr(resolve, "keeps", False):
        yield
        return
    kept: dict[Any, Any] = {}

    def signature_of(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws or not isinstance(ConfigStack.top_or_none(), KernelFlags):
            return resolve(self, context, args, kws)
        key = (self, context, tuple(args))
        found = kept.get(key) or resolve(self, context, args, kws)
        if found is not None:
            kept[key] = found
        return found

    signature_of.keeps = True  # type: ignore[attr-defined]
    BaseFunction.get_call_type = signature_of  # type: ignore[method-assign]
    try:
        yield
    finally:
        BaseFunction.get_call_type = resolve  # type: ignore[method-assign]


@contextmanager
def _uncollected() -> Iterator[None]:
    """Search for no garbage meanwhile.

    The compiler makes millions of small objects, and looking through them again and again took an eighth of its time.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class CallerDispatcher(CPUDispatcher):
    """A kernel that Python calls; the time in which it is compiled, or loaded from its file, is counted."""

    def compile(self, sig: Any) -> Any:
        """Return the machine code for a combination of types."""
        with preparing(), _uncollected():
            try:
                return super().compile(sig)
            finally:
                self._cache.release()


class CalleeDispatcher(CPUDispatcher):
    """A function that only kernels call, compiled once for each combination of types, whatever the literal values."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return numba's template of a call, without the values of literal arguments."""
        plain = tuple(types.unliteral(kind) for kind in args)
        return super().get_call_template(plain, {name: types.unliteral(kind) for name, kind in kws.items()})


class CalleeLibrary(JITCodeLibrary):
    """Code that is linked into that of its callers as it was lowered, and has no machine code of its own."""

    def add_llvm_module(self, ll_module: Any) -> None:
        """Add a module as it is."""
        self._final_module.link_in(ll_module)

    def finalize(self) -> None:
        """Leave the code as it is."""
        self._raise_if_finalized()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: Python cannot call it."""
        del name
        return 0

    @property
    def codegen(self) -> "CalleeLibrary":
        """Return this library, in place of the one where a compiled function keeps its environment."""
        return self

    def set_env(self, env_name: str, env: Any) -> None:
        """Keep no environment: only object mode and exceptions with computed arguments read it, and no kernel has any.

        The same holds of callees in machine code that numba loads from its cache.
        """


class CallerLibrary(JITCodeLibrary):
    """Code that Python calls, with that of all callees."""

    def finalize(self) -> None:
        """Link the callees, each once, and optimize all together."""
        self._linking_libraries: list[Any] = _all_behind(self._linking_libraries)
        super().finalize()

    def _optimize_final_module(self) -> None:
        """Optimize once: numba's cheap passes before bring reference counts together, as the full ones do."""
        made = self._codegen._module_pass_manager()
        if isinstance(made, tuple):
            passes, builder = made
            passes.run(self._final_module, builder)
        else:
            # numba before 0.62
            super()._optimize_final_module()


def _all_behind(libraries: list[Any]) -> list[Any]:
    """Return libraries with those that callees among them need: each once, and behind all that may call it.

    In this order LLVM sees each call before the function: it drops what nothing calls yet.
    """
    ended: dict[Any, None] = {}
    waiting = [(library, False) for library in libraries]
    while waiting:
        library, is_left = waiting.pop()
        if is_left:
            ended[library] = None
        elif library not in ended:
            waiting.append((library, True))
            if isinstance(library, CalleeLibrary):
                waiting.extend((needed, False) for needed in library._linking_libraries)
    return list(reversed(ended))


class CallerCompiler(Compiler):
    """Compile what Python calls."""

    library: type[JITCodeLibrary] = CallerLibrary

    def __init__(self, *context: Any) -> None:
        *before, flags, local_types = context
        super().__init__(*before, KernelFlags(flags), local_types)

    def compile_extra(self, func: Any) -> Any:
        """Compile a function and, nested in it, what it calls."""
        with signatures_kept():
            return super().compile_extra(func)

    def define_pipelines(self) -> Any:
        """Return numba's own steps, filling a library of the class that is wanted and writing code as in `lowering`."""
        if self.state.library is None:
            name = self.state.func_id.func_qualname
            self.state.library = self.library(codegen_of(self.state.targetctx), name)
            self.state.library.enable_object_caching()
        pipelines = super().define_pipelines()
        for made in pipelines:
            made.passes = [(ValueLowering if step is NativeLowering else step, text) for step, text in made.passes]
        return pipelines


class CalleeCompiler(CallerCompiler):
    """Compile what only kernels call."""

    library = CalleeLibrary
