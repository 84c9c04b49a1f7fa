"""From fits to causes: what stands, what cannot be told apart, what stays unexplained."""

FREE_CURVE = "on a curve that the blocks do not have"
