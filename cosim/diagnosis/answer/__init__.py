"""The findings as JSON, and the next experiment."""
