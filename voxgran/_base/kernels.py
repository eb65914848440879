"""The kernel decorator: numba's `njit`, resolved on the first call.

Decorating costs nothing, so that planning a scene or listing methods needs no numba. On the first call the function is
compiled with the kernels that it calls, and kept on disk under a hash of its code and of theirs: an edit compiles again
what depends on it and nothing else.
"""

import hashlib
import logging
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, cached_property, update_wrapper
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, TypeAlias

import numpy as np

from voxgran._base.errors import InputError, warn
from voxgran._base.files import is_private
from voxgran._base.lazy import load
from voxgran._base.stopping import heed

log = logging.getLogger(__name__)

#: what is called before and after each compilation
_Listener: TypeAlias = tuple[Callable[[], None], Callable[[], None]]
_listeners: ContextVar[tuple[_Listener, ...]] = ContextVar("listeners", default=())


class Kernel:
    """A function of arrays and scalars that is compiled when it is first called.

    Parameters
    ----------
    function : callable
        The plain Python function; `plain` keeps it for tests.
    counted : bool
        Whether it counts who holds the arrays that it is given.
    inlined : bool
        Whether its code is written into each kernel that calls it.
    """

    def __init__(self, function: Callable[..., Any], *, counted: bool = True, inlined: bool = False) -> None:
        self.plain = function
        self._counted = counted
        self._inlined = inlined
        self._compiled: Callable[..., Any] | None = None
        self._callee: Callable[..., Any] | None = None
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function; a signal that has been noted is heeded before."""
        heed()
        compiled = self._compiled or self.compiled()
        return compiled(*arguments)

    def compiled(self) -> Callable[..., Any]:
        """Return numba's dispatcher, made on the first request.

        Raises
        ------
        MissingLibraryError
            If numba cannot be loaded.
        """
        if self._compiled is None and _linking() is None:
            self._compiled = self.callee()
        if self._compiled is None:
            made: Any = self._dispatcher("CallerDispatcher", "CallerCompiler")
            made._cache = load("voxgran._base.compiling.kernel_files").KernelCache(
                made.py_func, self.code_hash[:16], cache_folder(), on_miss=self._tell, on_save=self._tell_end
            )
            self._compiled = made
        return self._compiled

    def callee(self) -> Callable[..., Any]:
        """Return the dispatcher that other kernels call, made on the first request; it is not kept on its own.

        Raises
        ------
        MissingLibraryError
            If numba cannot be loaded.
        """
        if self._callee is None and _linking() is None:
            public = {"nogil": True, "error_model": "numpy", "forceinline": self._inlined}
            self._callee = load("numba").njit(self._linked(), cache=True, **public)
        if self._callee is None:
            bare = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
            self._callee = self._dispatcher("CalleeDispatcher", "CalleeCompiler", **bare)
        return self._callee

    @cached_property
    def code_hash(self) -> str:
        """Hash of the code of the kernel, of the constants that it reads and of all kernels that it calls."""
        digest = hashlib.sha256(f"{type(self).__name__} {self._counted} {self._inlined}".encode())
        for part in _code_parts(self.plain.__code__):
            digest.update(part)
        names = self.plain.__globals__
        for name in sorted(_names_of(self.plain.__code__)):
            digest.update(f"{name}={_as_text(names.get(name))}".encode())
        for cell in self.plain.__closure__ or ():
            digest.update(_as_text(cell.cell_contents).encode())
        return digest.hexdigest()

    def _tell(self) -> None:
        """Say that the kernel is compiled."""
        log.info("compiling %s (once per machine)", self.plain.__qualname__)
        for begins, _ in _listeners.get():
            begins()

    def _tell_end(self) -> None:
        """Say that the kernel has been compiled."""
        for _, ends in _listeners.get():
            ends()

    def _dispatcher(self, kind: str, compiler: str, **options: Any) -> Callable[..., Any]:
        """Return a dispatcher of the function: its class and that of its compiler are named in `linking`."""
        linking = _linking()
        shared = {
            "nopython": True,
            "no_cfunc_wrapper": True,
            "boundscheck": None,
            "nogil": True,
            "error_model": "numpy",
        }
        own = {"_nrt": self._counted, "forceinline": self._inlined}
        made: Callable[..., Any] = getattr(linking, kind)(
            self._linked(), targetoptions={**shared, **own, **options}, pipeline_class=getattr(linking, compiler)
        )
        return made

    def _linked(self) -> FunctionType:
        """Return the function with the kernels that it names replaced by their dispatchers."""
        plain = self.plain
        if not isinstance(plain, FunctionType):
            raise InputError(f"{plain!r} is not a plain function: only such can be a kernel; write it with def")
        names = dict(plain.__globals__)
        for name in plain.__code__.co_names:
            if isinstance(names.get(name), Kernel):
                names[name] = names[name].callee()
        linked = FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__, plain.__closure__)
        linked.__module__, linked.__qualname__ = plain.__module__, plain.__qualname__
        return linked


@cache
def _linking() -> Any:
    """Return the module that compiles kernels by private parts of numba; None, with a warning, where these differ."""
    numba = load("numba")
    try:
        load("voxgran._base.compiling.kernel_files")
        return load("voxgran._base.compiling.linking")
    except (ImportError, AttributeError) as error:
        why = str(error.__cause__ or error).partition(" (")[0]
        warn(
            f"numba {numba.__version__} lacks what voxgran links kernels with ({why}): they are compiled by njit, "
            "which takes several times as long; install a version that voxgran requires",
            RuntimeWarning,
        )
        return None


def numba_is_loaded() -> bool:
    """Return whether numba is loaded, which takes longer than a small problem as plain Python."""
    return "numba" in sys.modules


class Instruction(Kernel):
    """A function that writes its own machine instructions, for kernels to call: numba's `intrinsic`, made lazily."""

    def compiled(self) -> Callable[..., Any]:
        """Return numba's intrinsic, made on the first request."""
        if self._compiled is None:
            self._compiled = load("numba.extending").intrinsic(self.plain)
        return self._compiled

    callee = compiled


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


def inlined_kernel(function: Callable[..., Any]) -> Kernel:
    """Compile a function that makes no arrays into each kernel that calls it (decorator).

    A call hands over seven words for each array; where few voxels are looked at, that takes longer than the work.
    """
    return Kernel(function, counted=False, inlined=True)


def _nothing() -> None:
    """Do nothing."""


@contextmanager
def telling_of_compilation(begins: Callable[[], None], ends: Callable[[], None] = _nothing) -> Iterator[None]:
    """Call functions before and after each kernel that is compiled meanwhile by this thread (context manager); those of
    an outer one are called, too.

    Parameters
    ----------
    begins, ends : callable
        What is called before a kernel is compiled, and after it.
    """
    token = _listeners.set((*_listeners.get(), (begins, ends)))
    try:
        yield
    finally:
        _listeners.reset(token)


def _code_parts(code: CodeType) -> Iterator[bytes]:
    """Yield what a function does: its instructions, names and constants, and those of functions inside it."""
    yield code.co_code
    yield repr((code.co_names, code.co_varnames, code.co_argcount, code.co_kwonlyargcount)).encode()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_parts(constant)
        else:
            yield repr(constant).encode()


def _names_of(code: CodeType) -> set[str]:
    """Return the names that a function and those inside it look up."""
    inner = (constant for constant in code.co_consts if isinstance(constant, CodeType))
    return set(code.co_names).union(*(_names_of(part) for part in inner))


def _as_text(value: object) -> str:
    """Return what of a global decides the compiled code, the same in every process."""
    if isinstance(value, Kernel):
        return value.code_hash
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple | list):
        return f"({', '.join(_as_text(item) for item in value)})"
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | np.generic):
        return repr(value)
    if isinstance(value, type) and hasattr(value, "_fields"):
        return f"{value.__module__}.{value.__qualname__} {value._fields}"
    # modules, classes and functions of libraries, whose versions decide what they are
    name = getattr(value, "__qualname__", getattr(value, "__name__", type(value).__qualname__))
    return f"{getattr(value, '__module__', '')}.{name}"


@cache
def cache_folder() -> Path:
    """Return the folder of compiled kernels, of which those that were long not used are removed.

    It lies in ``$VOXGRAN_CACHE``, else ``$XDG_CACHE_HOME/voxgran``, else ``~/.cache/voxgran``, else (none of them
    can be written, or other users may write there) in the folder for temporary files, one for each user.
    """
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    parents = (os.environ.get("VOXGRAN_CACHE"), os.path.join(home, "voxgran"))
    places = [Path(parent) / "kernels" for parent in parents if parent]
    places.append(Path(tempfile.gettempdir()) / f"voxgran-{os.getuid() if hasattr(os, 'getuid') else 'kernels'}")
    for folder in places:
        if _writable(folder):
            # what others could have written is not run
            if is_private(folder.stat()):
                load("voxgran._base.compiling.kernel_files").remove_forgotten(folder)
                return folder
            log.warning(
                "%s belongs to another user, or others may write there: kernels are programs, so that it is not read; "
                "name a folder of your own in VOXGRAN_CACHE",
                folder,
            )
    return Path(tempfile.mkdtemp(prefix="voxgran-"))


def _writable(folder: Path) -> bool:
    """Return whether a folder, made if needed, can be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError:
        return False
    return os.access(folder, os.W_OK)
