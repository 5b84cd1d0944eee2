"""What is wrong with a sensor: its stamps, counts, signs, axes, units, gaps and clock, each in one module."""
