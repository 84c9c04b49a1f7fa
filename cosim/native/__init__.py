"""FMI 2.0 FMUs that need no Python: the composed equations translated to C99 and compiled. See docs/native.md."""
