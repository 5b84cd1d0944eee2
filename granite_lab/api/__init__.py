"""Every command as a function: ``import granite_lab as gl; gl.ingest("trial.csv").to_frame()``.

The commands call these functions, or the ones behind them that also return what was written. Functions
return frozen records with `to_frame()` and raise `granite_lab.errors.LabError`; they print nothing
and write only where a folder or file is given.
"""
