"""LLVM's text to machine code in this process, by llvmlite."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from typing import Any

from llvmlite import binding

_loaded: list[Library] = []
"""All libraries stay until the process ends: LLVM frees them in no order that is known to be safe."""


class Library:
    """Machine code and the addresses of its functions.

    Args:
        code: an object file.
        names: of the functions that are wanted.
    """

    def __init__(self, code: bytes, names: Iterable[str]) -> None:
        self._code = code  # the engine does not copy it
        self._engine = binding.create_mcjit_compiler(binding.parse_assembly(""), _target(0))
        self._engine.add_object_file(binding.ObjectFileRef.from_data(code))
        self._engine.finalize_object()
        self.address = {name: self._engine.get_function_address(name) for name in names}
        _loaded.append(self)


@cache
def _started() -> str:
    """Start LLVM; return what the machine code depends on beside its text."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    features = binding.get_host_cpu_features().flatten()
    return (
        f"{binding.llvm_version_info} {binding.get_default_triple()} {binding.get_host_cpu_name()} {features}"
    )


@cache
def _target(effort: int) -> Any:
    _started()
    return binding.Target.from_default_triple().create_target_machine(
        cpu=binding.get_host_cpu_name(),
        features=binding.get_host_cpu_features().flatten(),
        opt=effort,
    )


def compiled(text: str, *, effort: int) -> bytes:
    """Return an object file.

    Args:
        text: a module in LLVM's language.
        effort: 0 to compile fast; 1 for code that takes two thirds of the time, as more stays in registers,
            and three times as long to compile; 2 to improve the text, too, which takes longest.

    Raises:
        RuntimeError: LLVM does not accept the text.
    """
    target = _target(effort)
    module = binding.parse_assembly(text)
    if effort > 1:
        options = binding.create_pipeline_tuning_options(effort)
        builder = binding.create_pass_builder(target, options)
        builder.getModulePassManager().run(module, builder)
    return bytes(target.emit_object(module))


def key(*parts: str | bytes) -> str:
    """Return a name for machine code made from these parts on this machine."""
    digest = hashlib.sha256(_started().encode())
    for part in parts:
        digest.update(part.encode() if isinstance(part, str) else part)
        digest.update(b"\0")
    return digest.hexdigest()
