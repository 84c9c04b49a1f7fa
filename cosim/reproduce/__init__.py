"""The figures and tables of the source's chapters 4 and 5, made anew from synthetic logs and set beside what it prints."""
