"""What other data say of the causes: another log, the rest of this one, windows left out."""
