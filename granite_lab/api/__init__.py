"""Every command as a function: ``import granite_lab as gl; gl.ingest("trial.csv").to_frame()``.

The commands call these functions, or the same stages of the chain; nothing is done twice. Functions
return frozen records with `to_frame()` and raise `granite_lab.errors.LabError`; they print nothing
and write only where a folder or file is given.
"""
