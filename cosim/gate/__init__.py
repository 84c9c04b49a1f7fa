"""`cosim check`: a model held against reference logs and the limits kept in a file."""
