"""The diagnosis from log to findings, step by step."""
