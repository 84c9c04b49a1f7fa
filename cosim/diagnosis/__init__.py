"""Names what a simulation gets wrong, from a log."""
