"""From fits to causes: what stands, what cannot be told apart, what stays unexplained."""
