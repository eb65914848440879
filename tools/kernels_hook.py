"""What hatchling calls for a wheel: puts compiled kernels into it, if ``VOXGRAN_KERNELS`` names their folder.

Such a wheel is one of a platform. It serves all versions of Python: those for which it has no kernels compile them.
"""

import os
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Kernels(BuildHookInterface):
    """Adds the folder of kernels and the tag of the platform."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add them, where there are any."""
        del version
        if folder := os.environ.get("VOXGRAN_KERNELS"):
            for path in Path(folder).resolve().glob("*.kernel"):
                build_data["force_include"][str(path)] = f"voxgran/_base/compiling/kernels/{path.name}"
            # code that calls what numba brings and mathematical functions that each C library has
            build_data["tag"], build_data["pure_python"] = "py3-none-manylinux_2_17_x86_64", False
