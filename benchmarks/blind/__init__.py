"""The blind suite: effects hidden in the virtual rig at sizes drawn at run time, and how often the diagnosis names them."""
