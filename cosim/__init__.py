"""Co-simulation of the slew drive of a hydraulic loader crane, compared with measured data."""
