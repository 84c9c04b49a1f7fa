"""One module a command; each defines ``register(app)``, which adds its commands to the typer application."""
