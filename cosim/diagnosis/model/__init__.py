"""What a log is held against: a model's wiring, cut at its measured signals into groups."""
