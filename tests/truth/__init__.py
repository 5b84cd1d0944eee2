"""An implementation of the paper, of sensors and of their faults that shares no code with the package."""
