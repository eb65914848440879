"""The kernel decorator: numba's `njit`, resolved on the first call.

Decorating costs nothing, so that planning a scene or listing methods needs no numba. On the first call the function is
compiled with `cache=True, nogil=True`, and the kernels that it calls with it. numba does not notice when a
callee in another file changes; so the cache folder carries a hash of all kernel sources of the package.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache, update_wrapper
from pathlib import Path
from types import FunctionType
from typing import Any

from voxgran._base.errors import InputError
from voxgran._base.lazy import load


class Kernel:
    """A function of arrays and scalars that is compiled when it is first called.

    Parameters
    ----------
    function : callable
        The plain Python function; `plain` keeps it for tests.
    counted : bool
        Whether it counts who holds the arrays that it is given.
    inlined : bool
        Whether its instructions are put where it is called.
    """

    def __init__(self, function: Callable[..., Any], counted: bool = True, inlined: bool = False) -> None:
        self.plain = function
        self._counted = counted
        self._inlined = inlined
        self._compiled: Callable[..., Any] | None = None
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        compiled = self._compiled or self.compiled()
        return compiled(*arguments)

    def compiled(self) -> Callable[..., Any]:
        """Return numba's dispatcher, made on the first request.

        Raises
        ------
        MissingLibraryError
            If numba cannot be loaded.
        """
        if self._compiled is None:
            numba = load("numba")
            before = numba.config.CACHE_DIR
            numba.config.CACHE_DIR = str(cache_folder())
            try:
                options = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": self._counted}
                options["forceinline"] = self._inlined
                self._compiled = numba.njit(**options)(self._linked())
            finally:
                numba.config.CACHE_DIR = before
        return self._compiled

    def _linked(self) -> FunctionType:
        """Return the function with the kernels that it names replaced by their dispatchers."""
        plain = self.plain
        if not isinstance(plain, FunctionType):
            raise InputError(f"{plain!r} is not a plain function: only such can be a kernel; write it with def")
        names = dict(plain.__globals__)
        for name in plain.__code__.co_names:
            if isinstance(names.get(name), Kernel):
                names[name] = names[name].compiled()
        linked = FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__, plain.__closure__)
        linked.__module__, linked.__qualname__ = plain.__module__, plain.__qualname__
        return linked


class Instruction(Kernel):
    """A function that writes its own machine instructions, for kernels to call: numba's `intrinsic`, made lazily."""

    def compiled(self) -> Callable[..., Any]:
        """Return numba's intrinsic, made on the first request."""
        if self._compiled is None:
            self._compiled = load("numba.extending").intrinsic(self.plain)
        return self._compiled


def instruction(function: Callable[..., Any]) -> Instruction:
    """Let kernels call a function that takes types and returns a signature and a code generator (decorator)."""
    return Instruction(function)


def kernel(function: Callable[..., Any]) -> Kernel:
    """Compile a function with numba on its first call (decorator)."""
    return Kernel(function)


def bare_kernel(function: Callable[..., Any]) -> Kernel:
    """Compile a function that makes no arrays (decorator).

    It does not count who holds the arrays that it is given. In small kernels that hand many arrays to each other the
    counting takes several times as long as the work.
    """
    return Kernel(function, counted=False)


def inner_kernel(function: Callable[..., Any]) -> Kernel:
    """Compile a function like a bare kernel, and put its instructions where it is called (decorator).

    Records of many arrays are copied at each call; this is for kernels that hand them on.
    """
    return Kernel(function, counted=False, inlined=True)


@cache
def cache_folder() -> Path:
    """Return the folder of compiled kernels, keyed by a hash of all kernel sources of the package.

    It lies in ``$VOXGRAN_CACHE``, else ``$XDG_CACHE_HOME/voxgran``, else ``~/.cache/voxgran``, else (none of them
    can be written) in the folder for temporary files.
    """
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        source = path.read_bytes()
        if any(mark in source for mark in (b"@kernel", b"@bare_kernel", b"@inner_kernel", b"@instruction")):
            digest.update(path.name.encode() + b"\0" + source)
    name = f"kernels-{digest.hexdigest()[:16]}"
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    for parent in (os.environ.get("VOXGRAN_CACHE"), os.path.join(home, "voxgran")):
        if parent and (folder := _writable(Path(parent) / name)):
            return folder
    return Path(tempfile.mkdtemp(prefix="voxgran-"))


def _writable(folder: Path) -> Path | None:
    """Return the folder, made if needed, or None where nothing can be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None
