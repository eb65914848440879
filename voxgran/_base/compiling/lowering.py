"""How intermediate code is written: what a variable holds is used where it is needed, and not stored and read again.

numba gives each variable that more than one block of a function uses a place on the stack: the value is stored there,
read at each use, and zeros are stored before and after. LLVM removes all of it, which took a third of a compilation
where the values are records of dozens of arrays. Here a variable that is assigned once, before each use on every path,
has no place; variables that count who holds an array keep theirs.

This file is loaded when a kernel is compiled, never before: it imports numba.
"""

from collections import Counter
from typing import Any

from numba.core import ir
from numba.core.analysis import compute_cfg_from_blocks, compute_use_defs
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering


class ValueLower(Lower):
    """Writes the intermediate code of a function."""

    def _find_singly_assigned_variable(self) -> None:
        """Find the variables that have no place: to those of one block, which numba finds, others are added."""
        super()._find_singly_assigned_variable()
        self._placeless: set[str] = set()
        if self.func_ir.func_id.is_generator:
            return
        uses = compute_use_defs(self.blocks).usemap
        before = compute_cfg_from_blocks(self.blocks).dominators()
        many: Counter[str] = Counter()
        place = {}
        for block, content in self.blocks.items():
            for statement in content.find_insts(ir.Assign):
                many[statement.target.name] += 1
                place[statement.target.name] = block
        once = {name for name, count in many.items() if count == 1 and not self._is_counted(name)}
        for block, names in uses.items():
            for name in once & names:
                # blocks are written in their order
                if not (place[name] < block and place[name] in before[block]):
                    once.discard(name)
        self._singly_assigned_vars |= once
        self._placeless = once

    def delvar(self, name: str) -> None:
        """End the life of a variable: one without a place leaves nothing behind."""
        if name not in self._placeless:
            super().delvar(name)

    def _is_counted(self, name: str) -> bool:
        """Return whether a variable counts who holds an array."""
        model = self.context.data_model_manager[self.typeof(name)]
        return bool(self.context.enable_nrt and model.contains_nrt_meminfo())


@register_pass(mutates_CFG=True, analysis_only=False)
class ValueLowering(NativeLowering):
    """The step of the compiler that writes intermediate code."""

    _name = "value_lowering"

    @property
    def lowering_class(self) -> Any:
        """Return what writes it."""
        return ValueLower
