"""Inference that knows of no machine: held-out gains from one fit, and a linear reference of free order."""
