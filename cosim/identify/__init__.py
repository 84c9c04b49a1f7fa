"""Identification, chapter 4 of the source: dead zone, frequency response, transfer functions, observer, scaling."""
