"""The physical effects, one a file; see `fmus.effects.registry` for how they are found."""
