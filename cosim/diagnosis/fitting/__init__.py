"""A group's parameters estimated under priors, with the noise of its signals."""
