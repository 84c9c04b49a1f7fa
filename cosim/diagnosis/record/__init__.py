"""A log made ready: its samples, its time, what its readings look like."""
