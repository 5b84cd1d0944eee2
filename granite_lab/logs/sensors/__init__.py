"""What is wrong with a sensor: stamps, counts, signs, axes, units, gaps and clock, each judged once."""
