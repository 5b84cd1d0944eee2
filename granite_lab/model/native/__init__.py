"""Compiled right-hand sides: from a CasADi graph by LLVM to machine code, and an integrator for it."""
