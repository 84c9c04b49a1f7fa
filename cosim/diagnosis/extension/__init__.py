"""The extended model: all groups together, its values, its packages, what it gains."""
