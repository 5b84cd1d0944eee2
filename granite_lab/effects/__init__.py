"""Candidate effects that the paper's model leaves out: one module each, found by listing this folder.

Equation, source, parameters and signature stand in each module; `docs/effects.md` lists all but the sources.
"""

from granite_lab.effects.library import get, library, load_effects

__all__ = ["get", "library", "load_effects"]
