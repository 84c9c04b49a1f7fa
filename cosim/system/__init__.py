"""A system of FMUs as a function from values to signals: its graph, cut at what was measured, and effects at its ports."""
