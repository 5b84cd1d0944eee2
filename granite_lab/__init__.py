"""Experiment analysis for a light four-wheeled robot driving straight over dry sand.

Every command is also a function here, as in ``import granite_lab as gl; gl.ingest("trial.csv")``;
see docs/api.md. Each is imported when it is first asked for, so that the package itself costs nothing.
"""

from __future__ import annotations

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
