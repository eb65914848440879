"""How kernels are compiled that other kernels call.

numba optimizes each function and makes machine code of it, and does both again for its copy in every function that
calls it. A kernel that only kernels call needs neither: here its intermediate code is kept as it was lowered, and
optimized once, in the kernel that Python calls, which links the code of all that it calls directly or indirectly.

This file is loaded when a kernel is compiled, never before: it imports numba.
"""

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class CalleeLibrary(JITCodeLibrary):
    """Code that is linked into that of its callers as it was lowered, and has no machine code of its own."""

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

    def define_pipelines(self) -> Any:
        """Return numba's own steps, which fill a library of the class that is wanted."""
        if self.state.library is None:
            name = self.state.func_id.func_qualname
            self.state.library = self.library(self.state.targetctx.codegen(), name)
            self.state.library.enable_object_caching()
        return super().define_pipelines()


class CalleeCompiler(CallerCompiler):
    """Compile what only kernels call."""

    library = CalleeLibrary
