"""Which effects of the library explain what is left, and which could not have shown."""
