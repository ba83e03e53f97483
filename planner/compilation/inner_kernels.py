"""Inner kernels: leave machine code to the kernels that Python calls.

numba optimises each kernel with all that it calls, and writes machine code for it, also for one
that only other kernels call. Such code is never run: the callers contain the kernel once more. A
kernel below four others was optimised five times.
"""
# numba has no types; what is changed here is private to it.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportPrivateUsage=false

from __future__ import annotations

from typing import Any, Final

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.targetconfig import TargetConfig
from numba.core.typed_passes import BaseNativeLowering

ENVIRONMENT_PREFIX: Final = "_ZN08NumbaEnv"
"""Beginning of the names of those global variables in a kernel's machine code that numba writes to
after each compilation, so that they must exist."""


class InnerLibrary(JITCodeLibrary):
    """Code of a kernel that only other kernels call, for their optimisation.

    Machine code holds nothing but the global variables that numba expects there.
    """

    def _optimize_final_module(self) -> None:
        """Leave it to the kernels that call this one."""

    def _finalize_final_module(self) -> None:
        code = self._final_module
        variables = [variable.name for variable in code.global_variables]
        self._final_module = binding.parse_assembly(
            "\n".join(
                [
                    str(self._codegen._create_empty_module(self.name)),
                    *(
                        f"@{name} = common global ptr null"
                        for name in variables
                        if name.startswith(ENVIRONMENT_PREFIX)
                    ),
                ]
            )
        )
        self._final_module.name = code.name
        super()._finalize_final_module()
        self._final_module = code
        self._finalize_dynamic_globals()


def leave_inner_kernels_to_callers() -> None:
    """Have numba make no machine code of inner kernels from now on in this process.

    They are the kernels with the options ``INNER``, and numba's own functions. Options of
    compilations are compared faster, too.
    """
    compile_pass: Any = BaseNativeLowering
    lower = compile_pass.run_pass
    if lower.__module__ == __name__:
        return

    def run_pass(self: object, state: Any) -> bool:
        flags = state.flags
        is_numba = state.func_id.modname.startswith("numba.")
        if flags.no_cpython_wrapper and (is_numba or flags.no_cfunc_wrapper):
            flags.no_cfunc_wrapper = True
            if state.library is None:
                codegen = state.targetctx.codegen()
                state.library = codegen.create_library(state.func_id.func_qualname)
                state.library.enable_object_caching()
            state.library.__class__ = InnerLibrary
        return lower(self, state)

    compile_pass.run_pass = run_pass
    options: Any = TargetConfig
    options.__hash__ = _hash_of_options
    options.__eq__ = _equal_options


def _hash_of_options(options: TargetConfig) -> int:
    """Return one hash for all options of a compilation.

    numba looks its functions up 80 000 times by arguments and options, which hardly differ: to sort
    and hash all 40 of them each time takes a twentieth of the compilation.
    """
    return hash(TargetConfig)


def _equal_options(options: Any, other: object) -> bool:
    """Return True if all options are the same; most pairs are so in those that are set."""
    if not isinstance(other, TargetConfig):
        return NotImplemented
    second: Any = other
    return options._values == second._values or options.values() == second.values()
