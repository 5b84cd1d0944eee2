"""The paper's model: contact (1)-(18), body (19)-(23), drive (24)-(26), command (5), simulator."""

from granite_lab.model.instants import Accuracy
from granite_lab.model.run import Run
from granite_lab.model.simulator import simulate

__all__ = ["Accuracy", "Run", "simulate"]
