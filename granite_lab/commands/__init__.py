"""The commands, grouped by what they work on; heavy libraries are imported inside them."""
