"""A second simulator of the drive, with another integrator and other forms of the same effects, for logs from end to end."""
