"""Random systems of small FMUs with something hidden in them: an independent simulation makes the log."""
