"""From CSV logs to a Trial: columns and units, clocks, wraps and gaps."""
